"""Job: find the floor, and optionally the scale, from markers lying on it.

The RESULT has "rig", the calibration as tables in a world whose origin is the markers' centre and whose floor is
y = 0, "markers", their number, and "scale", the factor applied to the calibration. After a STOP there is no RESULT.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial

from ...errors import CalibrationError
from ...geometry.rig_file import rig_tables
from ...simulate.studio.floor_marker_source import FloorMarkers
from ...simulate.studio.simulated_performer import SimulatedPerformer
from ...simulate.studio.studio_rig import default_rig
from ...vision.blob_preview import draw_blobs
from ...vision.calibration.floor_watch import FloorWatch, scaled_to
from ...vision.calibration.rig_on_floor import rig_on_floor
from ...vision.live_frames import live_settings
from ...vision.pipeline import MarkerPipeline
from ...vision.sources.image_set import ImageSource
from ..channel import Channel, Stopped
from ..requests import FloorMarkersRequest
from ..worker_settings import WORKER
from .camera_frames import open_pipeline
from .preview_sender import PreviewSender


def run(request: FloorMarkersRequest, channel: Channel) -> None:
    """Find the floor.

    Raises:
        PerfanimError: The source cannot be opened or used, or does not show markers that lie still.
    """
    with _open(request, channel) as (source, pipeline):
        watch = _watch(source, pipeline, PreviewSender(request.preview, channel), channel)
    if watch.points_m is None:
        raise CalibrationError("no markers were seen lying still on the floor", advice=watch.advice)
    rig, points_m, scale = pipeline.rig, watch.points_m, 1.0
    if request.longest_m:
        rig, points_m, scale = scaled_to(rig, points_m, request.longest_m)
    level = rig_on_floor(rig, points_m, above_m=request.height_m)
    channel.send_result({"rig": rig_tables(level), "markers": len(points_m), "scale": scale})


@contextmanager
def _open(request: FloorMarkersRequest, channel: Channel) -> Iterator[tuple[ImageSource, MarkerPipeline]]:
    if not isinstance(request.source, SimulatedPerformer):
        with open_pipeline(request, channel) as pair:
            yield pair
        return
    source = FloorMarkers(default_rig(request.source.cameras))
    pipeline = MarkerPipeline(request.rig, live_settings(request.threshold))
    pipeline.learn_empty(source.background_frames(WORKER.empty_images))
    yield source, pipeline


def _watch(source: ImageSource, pipeline: MarkerPipeline, preview: PreviewSender, channel: Channel) -> FloorWatch:
    """Watch the markers until they lie still, or until the source ends."""
    watch, sent = FloorWatch(), ""
    thresholds = [detector.threshold for detector in pipeline.detectors]
    for images in source:
        if channel.stop_requested.is_set():
            raise Stopped
        time_s = images.mean_time_s
        if time_s is not None:  # at least one camera gives images
            frame = pipeline.process(images)
            watch.see(time_s, frame.points_m)
            preview.send(images.images, partial(draw_blobs, frame, thresholds, pipeline.rig))
        if watch.points_m is not None:
            break
        advice = "; ".join(images.notes) or watch.advice
        if advice != sent:
            sent = advice
            channel.send_status(advice)
    return watch
