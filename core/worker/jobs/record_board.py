"""Job: calibrate the cameras from a board that is carried in front of them.

A STOP ends it with the views taken so far. The RESULT is that of `perfanim calibrate cameras`, with "pictures", the
folders, and "rig", the calibration as tables: Blender writes the file, so that a cancelled calibration replaces none.
"""

import time
from collections.abc import Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from functools import partial
from itertools import chain
from pathlib import Path

from ...errors import CaptureError
from ...geometry.arrays import Image
from ...geometry.rig_file import rig_tables
from ...simulate.studio.boards import BoardPose, CarriedBoard, board_poses
from ...simulate.studio.render import Renderer
from ...simulate.studio.simulated_performer import SimulatedPerformer
from ...simulate.studio.studio_rig import default_rig
from ...subjects.setup_check.board_faults import board_faults
from ...vision.calibration.board_preview import draw_corners, draw_coverage, draw_taken, draw_wanted
from ...vision.calibration.board_session import BoardSession, Guidance
from ...vision.calibration.calibrate import calibration_summary
from ...vision.calibration.calibration_board import Board, parse_board
from ...vision.sources.image_files import write_image
from ...vision.sources.image_set import ImageSet, ImageSource, camera_title
from ..channel import Channel
from ..open_source import open_source
from ..requests import ImageSourceRequest, RecordBoardRequest
from ..worker_settings import WORKER
from .preview_sender import PreviewSender


def run(request: RecordBoardRequest, channel: Channel) -> None:
    """Calibrate and send the RESULT.

    Raises:
        PerfanimError: The source cannot be opened or used, or does not show the board.
    """
    board, folder = parse_board(request.board), Path(request.out)
    channel.send_status("opening the cameras", 0.0)
    with closing(open_board(request.source, board)) as source, ThreadPoolExecutor(1) as later:
        images = iter(source)
        first = next(images, None)
        if first is None:
            raise CaptureError("the cameras gave no images", advice="check the source")
        names, titles = camera_names(len(first.images))
        folders = [_empty_folder(folder / name) for name in names]
        session = BoardSession(board, names, titles, later.submit, request.limit, request.every_s)
        _watch(chain([first], images), session, folders, PreviewSender(request.preview, channel), channel)
        channel.send_status("calibrating", 1.0)
        result = session.finish()
    summary = calibration_summary(result, board.square_m)
    summary["advice"] += [finding.text for finding in board_faults(board, session.board_views)]
    channel.send_result({**summary, "rig": rig_tables(result.rig), "pictures": [str(path) for path in folders]})


def camera_names(count: int) -> tuple[list[str], list[str]]:
    """Return the cameras' names in the calibration, and their names in messages."""
    names = ["left", "right"] if count == 2 else [f"camera{index + 1}" for index in range(count)]
    titles = [camera_title(index, names) for index in range(count)]
    return names, titles if count == 2 else ["the camera"] if count == 1 else [f"camera {i + 1}" for i in range(count)]


def _empty_folder(folder: Path) -> Path:
    """Create a folder, or remove the pictures of an earlier calibration from it; return it."""
    folder.mkdir(parents=True, exist_ok=True)
    for old in folder.glob("*.png"):
        old.unlink()
    return folder


def open_board(asked: ImageSourceRequest, board: Board, poses: Sequence[BoardPose] = ()) -> ImageSource:
    """Return the source; a simulated one shows the board in `poses`, or in many positions if there are none."""
    if not isinstance(asked, SimulatedPerformer):
        return open_source(asked)
    rig = default_rig(asked.cameras)
    return CarriedBoard(Renderer(rig), board, poses or board_poses(rig, board, WORKER.board_places))


def _watch(
    images: Iterable[ImageSet],
    session: BoardSession,
    folders: Sequence[Path],
    preview: PreviewSender,
    channel: Channel,
) -> None:
    """Pass images to the session until it is done, a stop is requested, or the source ends."""
    sent, taken_s = ("", -1), -WORKER.taken_s
    for image_set in images:
        if channel.stop_requested.is_set():
            return
        advice, time_s = "; ".join(image_set.notes), image_set.mean_time_s
        if time_s is not None:  # at least one camera gives images
            guidance = session.see(time_s, image_set.images, image_set.usable)
            if guidance.taken:
                taken_s = time.monotonic()
                for folder, image in zip(folders, image_set.images, strict=True):
                    write_image(folder / f"{session.views - 1:03d}.png", image)
            if guidance.seen is not None:
                is_new = time.monotonic() - taken_s < WORKER.taken_s
                preview.send(image_set.images, partial(_draw, session, guidance, is_new))
            advice = advice or guidance.advice
        if (advice, session.views) != sent:
            sent = (advice, session.views)
            channel.send_status(advice, session.fraction, heading=_heading(session), views=session.views)
        if session.done:
            return


def _heading(session: BoardSession) -> str:
    views = "1 view" if session.views == 1 else f"{session.views} views"
    return views if session.result is None else f"{views}, {session.result.verdict}"


def _draw(
    session: BoardSession, guidance: Guidance, taken: bool, camera: int, picture: Image, image_width: int
) -> None:
    """Draw the board and the coverage in a camera's reduced picture (BGR)."""
    draw_coverage(picture, session.coverage[camera])
    view = guidance.seen.views[camera] if guidance.seen is not None else None
    if view is not None:
        draw_corners(picture, view, image_width)
    if guidance.target is not None and guidance.target[0] == camera:
        draw_wanted(picture, guidance.target[1])
    if taken:
        draw_taken(picture)
