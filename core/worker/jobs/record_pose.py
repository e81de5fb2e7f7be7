"""Job: record the performer in calibration poses, one after another.

The recording continues between the poses, so that trajectories are unbroken; `pose_points` finds the poses.
"""

import math
import time
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

from ...body.calibration_poses import INSTRUCTIONS, POSES
from ...errors import CalibrationError, CaptureError, TakeError
from ...formats.markers.marker_files import write_take
from ...geometry.rig_file import save_rig
from ...labelling.trajectory_linking import track_markers
from ...labelling.trajectory_naming import name_trajectories
from ...markers.floor_from_feet import floor_points, to_rig_world
from ...markers.marker_set import load_marker_set
from ...markers.marker_take import MarkerTake
from ...simulate.studio.simulated_performer import SimulatedPerformer
from ...simulate.studio.stage_placement import STAGE
from ...subjects.pose_calibration import check_poses
from ...vision.calibration.rig_on_floor import rig_on_floor
from ...vision.sources.image_set import ImageSet
from ..channel import Channel, Stopped
from ..job_status import PoseCue, PoseStage
from ..requests import RecordPoseRequest
from ..worker_settings import WORKER
from .camera_frames import open_pipeline


def run(request: RecordPoseRequest, channel: Channel) -> None:
    """Record, and send a RESULT with the files written; no RESULT after a STOP.

    Raises:
        PerfanimError: The source cannot be opened or used, or does not show the performer.
    """
    channel.send_result(record_poses(request, channel)[1])


def record_poses(request: RecordPoseRequest, channel: Channel) -> tuple[MarkerTake, dict[str, Any]]:
    """Write a take of the poses; return it and the RESULT.

    If the calibration has no floor, it is found from the feet in the first pose.

    Raises:
        Stopped: A stop was requested meanwhile. PerfanimError: As in `run`.
    """
    marker_set, poses = load_marker_set(request.marker_set), request.poses
    check_poses(poses)
    if isinstance(request.source, SimulatedPerformer):
        performer = replace(request.source, poses=poses, held_s=request.seconds)
        request = replace(request, source=performer, between_s=STAGE.arrival_s)
    with open_pipeline(request, channel) as (source, pipeline):
        frames = [pipeline.process(images) for images in _moments(request, iter(source), channel)]
    if not frames:
        raise CaptureError("the source gave no images of the poses", advice="check the source")
    rig = pipeline.rig
    channel.send_status("linking the markers into trajectories")
    take = name_trajectories(track_markers(frames, "calibration", source.fps, len(marker_set)).take, marker_set)
    result: dict[str, Any] = {"frames": take.frames, "out": request.out}
    if request.rig is not None and "floor" not in rig.metadata:
        try:
            level = rig_on_floor(rig, floor_points(take, marker_set, POSES[poses[0]]))
        except (TakeError, CalibrationError) as error:
            result["floor_advice"] = str(error)
        else:
            save_rig(level, request.floor_out)
            take = to_rig_world(take, rig, level)
            result["calibration"] = request.floor_out
    write_take(take, request.out)
    return take, result


def _moments(request: RecordPoseRequest, images: Iterator[ImageSet], channel: Channel) -> Iterator[ImageSet]:
    """Yield the image sets from the first pose to the last, and send the instructions."""
    poses = request.poses
    if request.source.is_live:
        count_down(images, request.countdown_s, channel, INSTRUCTIONS[poses[0]])
    elif not isinstance(request.source, SimulatedPerformer) and len(poses) > 1:
        # the performer of a recording does not follow these instructions, so the poses can be anywhere in it
        yield from _for_seconds(images, WORKER.recording_s, channel, "looking for the markers", None)
        return
    for number, pose in enumerate(poses):
        words = INSTRUCTIONS[pose]
        if number:
            yield from _for_seconds(images, request.between_s, channel, words, PoseStage.GET_READY)
        yield from _for_seconds(images, request.seconds, channel, words, PoseStage.HOLD)


def count_down(images: Iterator[ImageSet], seconds: float, channel: Channel, text: str) -> None:
    """Skip the images of a countdown, and send a text with the seconds left."""
    due_s, sent = time.perf_counter() + seconds, 0
    for _ in images:
        if channel.stop_requested.is_set():
            raise Stopped
        left = math.ceil(due_s - time.perf_counter())
        if left <= 0:
            return
        if left != sent:
            sent = left
            channel.send_status(f"{left}: {text}", cue=PoseCue(PoseStage.GET_READY, left))


def first_seconds(
    images: Iterable[ImageSet], seconds: float, channel: Channel, apart_s: float = 0.0
) -> Iterator[ImageSet]:
    """Yield the image sets of the first seconds that have times at least `apart_s` apart.

    Raises:
        Stopped: A stop was requested meanwhile.
    """
    end_s, due_s = math.inf, -math.inf
    for moment in images:
        if channel.stop_requested.is_set():
            raise Stopped
        time_s = moment.mean_time_s
        if time_s is None:
            continue
        end_s = min(end_s, time_s + seconds)
        if time_s >= end_s:
            return
        if time_s >= due_s:
            due_s = time_s + apart_s
            yield moment


def _for_seconds(
    images: Iterator[ImageSet], seconds: float, channel: Channel, text: str, stage: PoseStage | None
) -> Iterator[ImageSet]:
    """Yield image sets for `seconds`, and send the text, with the time left or the request to hold still."""
    start_s = None
    for image_set in images:
        start_s = image_set.times_s[0] if start_s is None else start_s
        passed_s = image_set.times_s[0] - start_s
        if channel.stop_requested.is_set():
            raise Stopped
        if passed_s >= seconds:
            return
        left = math.ceil(seconds - passed_s)
        before = {PoseStage.HOLD: "hold still: ", PoseStage.GET_READY: f"{left}: ", None: ""}[stage]
        channel.send_status(before + text, passed_s / seconds, cue=PoseCue(stage, left) if stage else None)
        yield image_set
