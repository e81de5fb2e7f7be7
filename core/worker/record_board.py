"""Pictures of the board, from which the cameras are calibrated.

Request: "source" (see `sources.spec`), "board" (its SPEC), "pictures" (how many), "every_s" (time to move the board
between two pictures, cameras only), "out" (folder; gets left/ and right/).
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..errors import CalibrationError, CaptureError
from ..files import atomic_path
from ..simulate.studio.boards import board_pictures
from ..simulate.studio.render import Renderer
from ..simulate.studio.rig import default_rig
from ..sources.spec import open_source
from ..vision.board import Board, find_board, parse_board
from ..vision.rig_fit import MINIMUM_VIEWS
from .camera_job import Stopped
from .channel import Channel
from .countdown import Line, counted_down

Image = NDArray[np.uint8]

SIDES = ("left", "right")
_TRIES_PER_PICTURE = 3


def run(request: Mapping[str, Any], channel: Channel) -> None:
    """Record; the RESULT says what was written, and there is none when a stop was asked for.

    Raises:
        PerfanimError: the source cannot be opened or used, or does not show the board.
    """
    try:
        channel.send_result(_record(request, channel))
    except Stopped:
        return


def _record(request: Mapping[str, Any], channel: Channel) -> dict[str, Any]:
    """Write pictures that show the board to both cameras; others are not kept."""
    board, wanted, folder = parse_board(request["board"]), int(request["pictures"]), Path(request["out"])
    for side in SIDES:
        (folder / side).mkdir(parents=True, exist_ok=True)
        for old in (folder / side).glob("*.png"):
            old.unlink()
    taken = tries = 0
    line = Line("hold the board still", 0.0)
    channel.send_status("opening the cameras", 0.0)
    for images in _moments(request, board, channel, line):
        tries += 1
        blind = [side for side, image in zip(SIDES, images, strict=True) if find_board(image, board) is None]
        if not blind:
            for side, image in zip(SIDES, images, strict=True):
                _write_image(folder / side / f"{taken:03d}.png", image)
            taken += 1
        line.text = f"not seen: {' and '.join(blind)}" if blind else f"{taken} of {wanted} taken, move the board"
        line.fraction = taken / wanted
        channel.send_status(line.text, line.fraction)
        if taken == wanted or tries == _TRIES_PER_PICTURE * wanted:
            break
    if taken < min(wanted, MINIMUM_VIEWS):
        raise CalibrationError(
            f"both cameras saw the board in {taken} of {tries} pictures, {min(wanted, MINIMUM_VIEWS)} are needed",
            advice="check its numbers of corners, hold it whole into both images, and give it light",
        )
    return {"pictures": taken, "tries": tries, **{side: str(folder / side) for side in SIDES}}


def _moments(request: Mapping[str, Any], board: Board, channel: Channel, line: Line) -> Iterator[tuple[Image, ...]]:
    """Yield the images of the moments at which pictures are due, counting down to each."""
    if request["source"].get("kind") == "simulated":
        count = _TRIES_PER_PICTURE * int(request["pictures"])
        for picture in board_pictures(Renderer(default_rig()), board, count):
            if channel.stop_requested.is_set():
                raise Stopped
            yield picture.images
        return
    source = open_source(request["source"])
    try:
        rest = iter(source)
        while True:
            images = counted_down(rest, float(request["every_s"]), channel, line)
            if images is None:
                return
            yield images.images
    finally:
        source.close()


def _write_image(path: Path, image: Image) -> None:
    with atomic_path(path) as temporary:
        if not cv2.imwrite(str(temporary), image):
            raise CaptureError("cannot be written", where=str(path), advice="check the free disk space")
