"""The cameras' process: images to marker frames until STOP or the end of the source.

Request: "source" (see `sources.spec`), "rig" (calibration file; null for the simulated performer, whose cameras are
known), "background_s" (seconds in which the empty room is learned, cameras only), "threshold" (grey levels or null),
"in_flight" (frames that may be on their way; null: no limit. Cameras cannot wait, all other sources can), "preview"
(see `preview`).
"""

import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from itertools import islice
from threading import Event
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..camera import CameraRig, load_rig
from ..errors import CaptureError
from ..sources.spec import ImageSetLike, ImageSource, open_source
from ..vision.blob_preview import draw_blobs
from ..vision.live import live_frames, live_settings
from ..vision.pipeline import MarkerPipeline
from .channel import Channel
from .preview import PreviewSender

Image = NDArray[np.uint8]

_EMPTY_FRAMES = 30  # of the simulated room
_SPREAD_FRAMES = 40  # of a recorded take, which shows the performer


class Stopped(Exception):  # noqa: N818 - no error: somebody asked for the end
    """A stop was asked for before the work was done."""


def run(request: Mapping[str, Any], channel: Channel) -> None:
    """Hand over marker frames.

    Raises:
        PerfanimError: the source cannot be opened, stops giving images, or does not fit the calibration.
    """
    in_flight = request.get("in_flight")
    # images of this size are done before a second thread has begun, and Blender draws on the other core
    cv2.setNumThreads(1)
    try:
        with opened(request, channel) as (source, pipeline):
            channel.send_status("waiting for images")
            for warning in getattr(source, "warnings", ()):
                channel.send_warning(warning)
            images = _Images(channel.stop_requested, source if is_live(request) else _paced(source))
            preview = PreviewSender(request, channel)
            thresholds = [detector.threshold for detector in pipeline.detectors]
            for stamp_s, frame in live_frames(images, pipeline, channel.send_warning, exact=is_simulated(request)):
                channel.send_frame(stamp_s, frame)
                preview.send(images.newest, partial(draw_blobs, frame, thresholds))
                if in_flight is not None:
                    channel.wait_taken(int(in_flight))
    except Stopped:
        return


class _Images:
    """Image sets until a stop is asked for; `newest` are the images of the last."""

    def __init__(self, stop: Event, images: Iterable[ImageSetLike]) -> None:
        self.newest: tuple[Image, ...] = ()
        self._stop = stop
        self._images = images

    def __iter__(self) -> Iterator[ImageSetLike]:
        for moment in self._images:
            if self._stop.is_set():
                return
            self.newest = moment.images
            yield moment


def is_live(request: Mapping[str, Any]) -> bool:
    """Return whether the images come from cameras, which do not wait."""
    return str(request["source"].get("kind", "")) == "cameras"


def is_simulated(request: Mapping[str, Any]) -> bool:
    """Return whether the images are the simulated performer's, whose time stamps are exact."""
    return str(request["source"].get("kind", "")) == "simulated"


@contextmanager
def opened(request: Mapping[str, Any], channel: Channel) -> Iterator[tuple[ImageSource, MarkerPipeline]]:
    """Yield the source and its pipeline with the backgrounds learned.

    Raises:
        Stopped: a stop was asked for meanwhile. PerfanimError: the source cannot be opened or lacks a calibration.
    """
    spec = dict(request["source"])
    channel.send_status("opening the cameras")
    source = open_source(spec)
    try:
        pipeline = MarkerPipeline(_rig(request, source), live_settings(request.get("threshold")))
        _learn(pipeline, source, str(spec.get("kind", "")), float(request.get("background_s", 2.0)), channel)
        yield source, pipeline
    finally:
        source.close()


def _rig(request: Mapping[str, Any], source: ImageSource) -> CameraRig:
    if request.get("rig"):
        return load_rig(str(request["rig"]))
    rig = getattr(source, "rig", None)
    if not isinstance(rig, CameraRig):
        raise CaptureError("the cameras are not calibrated", advice="calibrate them first")
    return rig


def _learn(pipeline: MarkerPipeline, source: Any, kind: str, seconds: float, channel: Channel) -> None:
    """Learn the backgrounds in the way that the kind of source allows."""
    if kind == "simulated":
        pipeline.learn_empty(_reported(source.background_frames(_EMPTY_FRAMES), _EMPTY_FRAMES, "", channel))
    elif kind == "cameras":
        count = max(2, round(seconds * source.fps))
        pipeline.learn_empty(_reported(source.samples(count), count, ": stay out of sight", channel))
    else:
        moments = list(_reported(source.samples(_SPREAD_FRAMES), _SPREAD_FRAMES, "", channel))
        if moments:  # a stream cannot be looked through beforehand
            pipeline.learn_behind(moments)


def _reported(
    moments: Iterator[tuple[Image, ...]], count: int, hint: str, channel: Channel
) -> Iterator[tuple[Image, ...]]:
    for number, images in enumerate(islice(moments, count)):
        if channel.stop_requested.is_set():
            raise Stopped
        channel.send_status("learning the background" + hint, number / count)
        yield images


def _paced(source: ImageSource) -> Iterator[ImageSetLike]:
    """Yield the images of a source that can wait, no faster than they were taken.

    Nothing is left out: on a machine that is too slow the performer moves slowly, instead of jumping.
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
