"""Recording what the calibrations need: pictures of the board, and the performer in the T pose.

Request for the board: "source" (see `sources.spec`), "board" (its SPEC), "pictures" (how many), "every_s" (time to move
the board between two pictures, cameras only), "out" (folder; gets left/ and right/).

Request for the T pose: what `camera_job` takes, and "marker_set" (name or file), "countdown_s" (time to take the pose,
cameras only), "seconds" (how long it is recorded), "out" (take to write), "floor_out" (calibration to write in a world
with the floor where the feet stand, if the present one has no floor).
"""

import math
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..calibration_pose import t_pose
from ..camera import CameraRig, save_rig
from ..errors import CalibrationError, CaptureError, TakeError
from ..files import atomic_path
from ..floor_from_feet import floor_points, moved_to_rig
from ..formats.takes import write_take
from ..marker_frame import MarkerFrame
from ..marker_set import MarkerSet, load_marker_set
from ..marker_take import MarkerTake
from ..simulate.studio.boards import board_pictures
from ..simulate.studio.render import Renderer
from ..simulate.studio.rig import default_rig
from ..sources.spec import ImageSetLike, ImageSource, open_source
from ..tracking import track_markers
from ..tracking_names import named_take
from ..tracking_single import single_views
from ..vision.board import Board, find_board, parse_board
from ..vision.floor import rig_on_floor
from ..vision.rig_fit import MINIMUM_VIEWS
from .camera_job import Stopped, is_live, opened
from .channel import Channel

Image = NDArray[np.uint8]

SIDES = ("left", "right")
_TRIES_PER_PICTURE = 3


def run(request: Mapping[str, Any], channel: Channel) -> None:
    """Record; the RESULT says what was written, and there is none when a stop was asked for.

    Raises:
        PerfanimError: the source cannot be opened or used, or does not show what is to be recorded.
    """
    try:
        record = {"board": _record_board, "pose": _record_pose}[str(request["what"])]
        channel.send_result(record(request, channel))
    except Stopped:
        return


@dataclass
class _Line:
    """What stands beside the countdown, and how much of the work is done."""

    text: str
    fraction: float | None = None


def _record_board(request: Mapping[str, Any], channel: Channel) -> dict[str, Any]:
    """Write pictures that show the board to both cameras; others are not kept."""
    board, wanted, folder = parse_board(request["board"]), int(request["pictures"]), Path(request["out"])
    for side in SIDES:
        (folder / side).mkdir(parents=True, exist_ok=True)
        for old in (folder / side).glob("*.png"):
            old.unlink()
    taken = tries = 0
    line = _Line("hold the board still", 0.0)
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


def _moments(request: Mapping[str, Any], board: Board, channel: Channel, line: _Line) -> Iterator[tuple[Image, ...]]:
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
            images = _counted_down(rest, float(request["every_s"]), channel, line)
            if images is None:
                return
            yield images.images
    finally:
        source.close()


def _counted_down(images: Iterator[ImageSetLike], seconds: float, channel: Channel, line: _Line) -> ImageSetLike | None:
    """Take images and tell the seconds that are left; return the first image set after them, None at the end."""
    due_s, told = time.perf_counter() + seconds, 0
    for image_set in images:
        if channel.stop_requested.is_set():
            raise Stopped
        left = math.ceil(due_s - time.perf_counter())
        if left <= 0:
            return image_set
        if left != told:
            told = left
            channel.send_status(f"{left}: {line.text}", line.fraction)
    return None


def _write_image(path: Path, image: Image) -> None:
    with atomic_path(path) as temporary:
        if not cv2.imwrite(str(temporary), image):
            raise CaptureError("cannot be written", where=str(path), advice="check the free disk space")


def _record_pose(request: Mapping[str, Any], channel: Channel) -> dict[str, Any]:
    """Write a take of the T pose; a floor is found from its feet."""
    marker_set = load_marker_set(request["marker_set"])
    with opened(request, channel) as (source, pipeline):
        images = iter(source)
        if is_live(request):
            _counted_down(images, float(request["countdown_s"]), channel, _Line("take the T pose"))
        seconds = float(request["seconds"])
        frames = [pipeline.process(image_set) for image_set in _for_seconds(images, seconds, channel)]
    rig = pipeline.rig
    take = _tracked(frames, source, marker_set, rig)
    result: dict[str, Any] = {"frames": take.frames, "out": str(request["out"])}
    if request.get("rig") and "floor" not in rig.metadata:
        try:
            level = rig_on_floor(rig, floor_points(take, marker_set, t_pose))
        except (TakeError, CalibrationError) as error:
            result["advice"] = str(error)
        else:
            save_rig(level, request["floor_out"])
            take = moved_to_rig(take, rig, level)
            result["calibration"] = str(request["floor_out"])
    write_take(take, request["out"])
    return result


def _for_seconds(images: Iterator[ImageSetLike], seconds: float, channel: Channel) -> Iterator[ImageSetLike]:
    start_s = None
    for image_set in images:
        start_s = image_set.times_s[0] if start_s is None else start_s
        passed_s = image_set.times_s[0] - start_s
        if channel.stop_requested.is_set():
            raise Stopped
        if passed_s >= seconds:
            return
        channel.send_status("hold the T pose", passed_s / seconds)
        yield image_set


def _tracked(frames: list[MarkerFrame], source: ImageSource, marker_set: MarkerSet, rig: CameraRig) -> MarkerTake:
    if not frames:
        raise CaptureError("there were no images of the T pose", advice="check the source")
    tracking = track_markers(frames, "T pose", source.fps, len(marker_set))
    single = single_views(tracking, frames, rig)
    return named_take(replace(tracking.take, single=single), marker_set)
