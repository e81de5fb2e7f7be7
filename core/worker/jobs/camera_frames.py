"""Job: turn images into marker frames until STOP or the end of the source."""

import time
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from functools import partial
from itertools import dropwhile, islice
from pathlib import Path
from threading import Event
from typing import Any

import cv2
import numpy as np

from ...errors import CaptureError
from ...geometry.arrays import Image
from ...geometry.camera import CameraRig
from ...geometry.npz import read_arrays, write_arrays
from ...markers.marker_frame import MarkerFrame
from ...simulate.studio.simulated_performer import SimulatedPerformer
from ...system.files import reading
from ...vision.blob_preview import draw_blobs
from ...vision.detection.background import Background, background_from_take, learn_backgrounds
from ...vision.live_frames import live_frames, live_settings
from ...vision.people.people_pipeline import PeoplePipeline
from ...vision.people.person_preview import draw_person
from ...vision.pipeline import MarkerPipeline
from ...vision.sources.image_set import ImageSet, ImageSource
from ..channel import Channel, Stopped, open_when_free
from ..open_source import open_source
from ..requests import CamerasRequest
from ..worker_settings import WORKER
from .film_starts import with_starts
from .person_pipeline import open_networks
from .preview_sender import Draw, PreviewSender


def run(request: CamerasRequest, channel: Channel) -> None:
    """Send marker frames.

    Raises:
        PerfanimError: The source cannot be opened, stops giving images, or does not fit the calibration.
    """
    # cameras' images are so small that a second thread starts too late to help, and Blender needs the other core
    cv2.setNumThreads(1)
    opened = _open_people if request.people else open_pipeline
    with opened(request, channel) as (source, pipeline):
        channel.send_status("waiting for images")
        for warning in getattr(source, "warnings", ()):
            channel.send_warning(warning)
        remaining = _remaining(request, source)
        images = _Images(channel.stop_requested, remaining if request.source.is_live else _pace(remaining))
        preview = PreviewSender(request.preview, channel)
        for stamp_s, frame in _frames(request, images, pipeline, channel):
            channel.slowness.add(time.perf_counter() - stamp_s, time.thread_time() - images.processor_s)
            channel.send_frame(stamp_s, frame)
            preview.send(images.newest, _drawing(frame, pipeline))
            if request.in_flight is not None:
                channel.wait_for_ack(request.in_flight)


def _frames(
    request: CamerasRequest, images: "_Images", pipeline: MarkerPipeline | PeoplePipeline, channel: Channel
) -> Iterator[tuple[float, MarkerFrame]]:
    """Yield each image set's time of arrival (`time.perf_counter()`) and its marker frame."""
    if isinstance(pipeline, PeoplePipeline):
        return ((time.perf_counter(), pipeline.process(moment)) for moment in images)
    is_exact = isinstance(request.source, SimulatedPerformer)
    return live_frames(images, pipeline, channel.send_warning, exact=is_exact)


def _drawing(frame: MarkerFrame, pipeline: MarkerPipeline | PeoplePipeline) -> Draw:
    """Return the function that draws what was found into the cameras' pictures."""
    if isinstance(pipeline, PeoplePipeline):
        return partial(draw_person, frame, pipeline.points.names)
    return partial(draw_blobs, frame, [detector.threshold for detector in pipeline.detectors], pipeline.rig)


class _Images:
    """Image sets until a stop is requested.

    Attributes:
        newest: Images of the last set.
        processor_s: CPU time of this thread when the set was yielded, s.
    """

    def __init__(self, stop: Event, images: Iterable[ImageSet]) -> None:
        self.newest: tuple[Image, ...] = ()
        self.processor_s = 0.0
        self._stop = stop
        self._images = images

    def __iter__(self) -> Iterator[ImageSet]:
        for moment in self._images:
            if self._stop.is_set():
                return
            self.newest, self.processor_s = moment.images, time.thread_time()
            yield moment


@contextmanager
def _open_people(request: CamerasRequest, channel: Channel) -> Iterator[tuple[ImageSource, PeoplePipeline]]:
    """Yield the source, and the pipeline that finds a person in its images; errors are those of `open_pipeline`."""
    request = with_starts(request, channel)
    with open_networks(request) as pipeline, _open_cameras(request, channel) as source:
        yield source, pipeline


@contextmanager
def open_pipeline(request: CamerasRequest, channel: Channel) -> Iterator[tuple[ImageSource, MarkerPipeline]]:
    """Yield the source, and its pipeline with learned backgrounds.

    Raises:
        Stopped: A stop was requested meanwhile. PerfanimError: The source cannot be opened or lacks a calibration.
    """
    with _open_cameras(request, channel) as source:
        pipeline = MarkerPipeline(_rig(request, source), live_settings(request.threshold))
        kept = Path(request.background_file)
        if request.after is not None and kept.is_file():
            pipeline.set_backgrounds(_read_backgrounds(kept))
        else:
            if learned := learn_room(source, request, channel):
                pipeline.set_backgrounds(learned)
            if kept.name:
                _keep_backgrounds(pipeline, kept)
        yield source, pipeline


@contextmanager
def _open_cameras(request: CamerasRequest, channel: Channel) -> Iterator[ImageSource]:
    channel.send_status("opening the cameras")
    opened = partial(open_source, request.source, newest=bool(request.people))
    source = open_when_free(opened, request.after is not None, channel.stop_requested)
    try:
        yield source
    finally:
        source.close()


def _keep_backgrounds(pipeline: MarkerPipeline, path: Path) -> None:
    known = [background for background in pipeline.backgrounds if background is not None]
    arrays = [array for background in known for array in (background.mean, background.deviation)]
    if len(known) == len(pipeline.backgrounds):
        write_arrays(path, {str(number): array for number, array in enumerate(arrays)}, packed=False)


def _read_backgrounds(path: Path) -> list[Background]:
    with reading(path, CaptureError, "start the capture again", "contains no backgrounds"):
        kept = read_arrays(path, CaptureError)
        arrays = [kept[str(number)].astype(np.float32) for number in range(len(kept))]
        return [Background(mean, deviation) for mean, deviation in zip(arrays[::2], arrays[1::2], strict=True)]


def _remaining(request: CamerasRequest, source: Any) -> Iterable[ImageSet]:
    """Return the images that the previous process has not processed."""
    if request.after is None or not request.source.is_repeatable:
        return source
    after = request.after.number
    if isinstance(request.source, SimulatedPerformer):
        source.first = after + 1
        return source
    return dropwhile(lambda images: images.number <= after, source)


def _rig(request: CamerasRequest, source: ImageSource) -> CameraRig:
    if request.rig is not None:
        return request.rig
    rig = getattr(source, "rig", None)
    if not isinstance(rig, CameraRig):
        raise CaptureError("the cameras are not calibrated", advice="calibrate them first")
    return rig


def learn_room(source: Any, request: CamerasRequest, channel: Channel) -> list[Background]:
    """Return the backgrounds of the cameras; an empty list for a video of unknown length.

    Raises:
        Stopped: A stop was requested meanwhile. PerfanimError: The source gives no images.
    """
    if isinstance(request.source, SimulatedPerformer):
        count = WORKER.empty_images
        return learn_backgrounds(_report_learning(source.background_frames(count), count, "", channel))
    if request.source.is_live:
        count = max(2, round(request.background_s * source.fps))
        return learn_backgrounds(_report_learning(source.samples(count), count, ": stay out of sight", channel))
    count = WORKER.spread_images
    moments = list(_report_learning(source.samples(count), count, "", channel))
    return [background_from_take(column) for column in zip(*moments, strict=True)]


def _report_learning(
    moments: Iterator[tuple[Image, ...]], count: int, hint: str, channel: Channel
) -> Iterator[tuple[Image, ...]]:
    for number, images in enumerate(islice(moments, count)):
        if channel.stop_requested.is_set():
            raise Stopped
        channel.send_status("learning the background" + hint, number / count)
        yield images


def _pace(source: Iterable[ImageSet]) -> Iterator[ImageSet]:
    """Yield the images of a recording at their original pace.

    No image is dropped: on a slow machine the performer moves slowly instead of jumping.
    """
    due_s, last_s = time.perf_counter(), None
    for images in source:
        moment_s = float(np.mean(images.times_s))
        due_s += 0.0 if last_s is None else moment_s - last_s
        last_s = moment_s
        early_s = due_s - time.perf_counter()
        if early_s > 0.0:
            time.sleep(early_s)
        else:
            due_s -= early_s
        yield images
