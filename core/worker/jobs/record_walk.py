"""Job: calibrate live cameras by a person who walks about in front of them, without a board.

The RESULT is that of `perfanim calibrate cameras`, with "rig", the calibration as tables: Blender writes the file, so
that a cancelled calibration replaces none.
"""

from collections.abc import Iterable
from contextlib import closing
from dataclasses import replace
from functools import partial
from itertools import chain

from ...errors import CaptureError
from ...geometry.camera import CameraRig
from ...geometry.rig_file import rig_tables
from ...markers.marker_frame import MarkerFrame
from ...vision.calibration.calibrate_moving import calibrate_with_person
from ...vision.calibration.moving_fit import cameras_with_lenses
from ...vision.people.people_pipeline import PeoplePipeline
from ...vision.people.person_clocks import synchronise_person
from ...vision.people.person_preview import draw_person
from ...vision.sources.image_set import ImageSet
from ..channel import Channel
from ..open_source import open_source
from ..requests import RecordWalkRequest
from .person_pipeline import open_networks
from .preview_sender import PreviewSender
from .record_board import camera_names
from .record_pose import count_down, first_seconds

_PLACE = "stand where all cameras see all of you"


def run(request: RecordWalkRequest, channel: Channel) -> None:
    """Calibrate and send the RESULT.

    Raises:
        Stopped: A stop was requested meanwhile.
        PerfanimError: The source or the network cannot be used, or the person does not determine the cameras.
    """
    channel.send_status("opening the cameras")
    with closing(open_source(request.source, newest=True)) as source:
        images = iter(source)
        count_down(images, request.countdown_s, channel, _PLACE)
        first = next(images, None)
        if first is None:
            raise CaptureError("the cameras gave no images", advice="check the source")
        sizes = [(image.shape[1], image.shape[0]) for image in first.images]
        cameras, is_free = cameras_with_lenses(camera_names(len(sizes))[0], sizes, request.rig)
        with open_networks(replace(request, rig=CameraRig(tuple(cameras)))) as pipeline:
            frames = _walk(chain([first], images), pipeline, request.seconds, channel)
    channel.send_status("calibrating", 1.0)
    frames, _ = synchronise_person(cameras, frames, pipeline.points, placed=False)
    found = calibrate_with_person(cameras, is_free, frames, pipeline.points, request.height_m)
    channel.send_result({**found.summary(), "rig": rig_tables(found.result.rig)})


def _walk(images: Iterable[ImageSet], pipeline: PeoplePipeline, seconds: float, channel: Channel) -> list[MarkerFrame]:
    """Return what the cameras see of the person in the first seconds; show it."""
    preview, frames = PreviewSender(True, channel), []
    for moment in first_seconds(images, seconds, channel):
        frames.append(pipeline.detect(moment))
        told = "; ".join(frames[-1].notes) or "walk about and turn, through the whole space"
        channel.send_status(told, (frames[-1].time_s - frames[0].time_s) / seconds)
        preview.send(moment.images, partial(draw_person, frames[-1], pipeline.points.names, placed=False))
    return frames
