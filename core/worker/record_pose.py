"""The performer in the T pose, from which the subject is calibrated.

Request: what `camera_job` takes, and "marker_set" (name or file), "countdown_s" (time to take the pose, cameras only),
"seconds" (how long it is recorded), "out" (take to write), "floor_out" (calibration to write in a world with the floor
where the feet stand, if the present one has no floor).
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

from ..calibration_pose import t_pose
from ..camera import CameraRig, save_rig
from ..errors import CalibrationError, CaptureError, TakeError
from ..floor_from_feet import floor_points, moved_to_rig
from ..formats.takes import write_take
from ..marker_frame import MarkerFrame
from ..marker_set import MarkerSet, load_marker_set
from ..marker_take import MarkerTake
from ..sources.spec import ImageSetLike, ImageSource
from ..tracking import track_markers
from ..tracking_names import named_take
from ..tracking_single import single_views
from ..vision.floor import rig_on_floor
from .camera_job import Stopped, is_live, opened
from .channel import Channel
from .countdown import Line, counted_down


def run(request: Mapping[str, Any], channel: Channel) -> None:
    """Record; the RESULT says what was written, and there is none when a stop was asked for.

    Raises:
        PerfanimError: the source cannot be opened or used, or does not show the performer.
    """
    try:
        channel.send_result(_record(request, channel))
    except Stopped:
        return


def _record(request: Mapping[str, Any], channel: Channel) -> dict[str, Any]:
    """Write a take of the T pose; a floor is found from its feet."""
    marker_set = load_marker_set(request["marker_set"])
    with opened(request, channel) as (source, pipeline):
        images = iter(source)
        if is_live(request):
            counted_down(images, float(request["countdown_s"]), channel, Line("take the T pose"))
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
