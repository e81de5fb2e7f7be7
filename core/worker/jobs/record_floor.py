"""Job: find the floor from the board lying on it.

The RESULT has "rig", the calibration as tables in a world whose origin is the board's centre and whose floor is y = 0,
and "scale", the board's size as measured with the calibration, divided by the size in its SPEC. After a STOP there is
no RESULT.
"""

from contextlib import closing
from functools import partial

import numpy as np

from ...errors import CalibrationError
from ...geometry.arrays import Image
from ...geometry.rig_file import rig_tables
from ...simulate.studio.boards import board_on_floor
from ...vision.calibration.board_preview import draw_corners
from ...vision.calibration.board_watch import BoardObservation, BoardWatch
from ...vision.calibration.calibration_board import Board, find_board, parse_board
from ...vision.calibration.rig_on_floor import board_in_space, rig_on_floor
from ...vision.sources.image_set import ImageSource
from ..channel import Channel
from ..requests import RecordFloorRequest
from .preview_sender import PreviewSender
from .record_board import camera_names, open_board


def run(request: RecordFloorRequest, channel: Channel) -> None:
    """Find the floor.

    Raises:
        PerfanimError: The source cannot be opened or used, or does not show the board on the floor.
    """
    board, rig = parse_board(request.board), request.rig
    channel.send_status("opening the cameras", 0.0)
    with closing(open_board(request.source, board, [board_on_floor(board)[0]])) as source:
        look = _still_board(source, board, PreviewSender(request.preview, channel), channel)
    if look is None:
        return
    points_m = board_in_space(rig, [view for view in look.views if view is not None], board)
    columns, rows = board.corner_grid
    sides = np.diff(points_m.reshape(rows, columns, 3), axis=1)
    scale = float(np.median(np.linalg.norm(sides, axis=2))) / board.square_m
    channel.send_result({"rig": rig_tables(rig_on_floor(rig, points_m)), "scale": scale})


def _still_board(
    source: ImageSource, board: Board, preview: PreviewSender, channel: Channel
) -> BoardObservation | None:
    """Return the views of the board once it lies still; None after a STOP."""
    watch, sent = BoardWatch(board, find_board), ""
    for image_set in source:
        if channel.stop_requested.is_set():
            return None
        advice, time_s = "; ".join(image_set.notes), image_set.mean_time_s
        if time_s is not None:  # at least one camera gives images
            look = watch.see(time_s, image_set.images, image_set.usable)
            preview.send(image_set.images, partial(_draw, look))
            if look.still:
                return look
            advice = advice or ("let it lie still" if look.together else _show_it(look))
        if advice != sent:
            sent = advice
            channel.send_status(advice)
    raise CalibrationError(
        "the cameras never saw the whole board at the same time, lying still",
        advice="lay it where all cameras see all of it",
    )


def _draw(look: BoardObservation, camera: int, picture: Image, image_width: int) -> None:
    view = look.views[camera]
    if view is not None:
        draw_corners(picture, view, image_width)


def _show_it(look: BoardObservation) -> str:
    titles = camera_names(len(look.views))[1]
    blind = [title for title, view in zip(titles, look.views, strict=True) if view is None]
    return f"lay the board on the floor where {' and '.join(blind)} {'sees' if len(blind) == 1 else 'see'} all of it"
