"""When videos of a person that were not started together began, for the jobs that play them."""

from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace

from ...markers.marker_frame import MarkerFrame
from ...vision.people.people_pipeline import PeoplePipeline
from ...vision.people.person_clocks import synchronise_person
from ...vision.sources.source_requests import VideoFiles
from ...vision.sources.video_source import VideoSource
from ..channel import Channel, Stopped
from ..requests import CamerasRequest
from ..worker_settings import WORKER
from .person_pipeline import open_networks


def with_starts(request: CamerasRequest, channel: Channel) -> CamerasRequest:
    """Return the request with the times at which its videos began, found from the motion if their lengths differ.

    Raises:
        Stopped: A stop was requested meanwhile.
        CaptureError: A video or the network cannot be read, or the motion does not tell how the videos belong together.
    """
    asked = request.source
    if not isinstance(asked, VideoFiles) or asked.is_live or len(asked.paths) < 2:
        return request
    with closing(VideoSource(asked.paths, asked.fps or 30.0, together=False)) as source:
        if not source.is_apart:
            return request
        with open_networks(request) as pipeline:
            frames = list(_seen(source, pipeline, channel))
        _, offsets = synchronise_person(pipeline.rig.cameras, frames, pipeline.points, placed=True)
    return replace(request, source=replace(asked, starts_s=tuple(each.offset_s for each in offsets)))


def _seen(source: VideoSource, pipeline: PeoplePipeline, channel: Channel) -> Iterator[MarkerFrame]:
    """Yield the person in the images of each video, of which some are left out."""
    due_s: dict[int, float] = {}
    for number, images in enumerate(source):
        if channel.stop_requested.is_set():
            raise Stopped
        video = images.usable.index(True)
        if images.times_s[video] >= due_s.get(video, 0.0):
            due_s[video] = images.times_s[video] + WORKER.compared_s
            channel.send_status("synchronising the videos by the motion", number / source.frames)
            yield pipeline.detect(images)
