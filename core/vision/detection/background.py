"""Background of a camera: mean and standard deviation of each pixel (Chai and Hodgins 2005, section on the cameras)."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from ...errors import CaptureError, counted
from ...geometry.arrays import Array, FloatArray, Image


@dataclass(frozen=True)
class Background:
    """Mean and standard deviation (height, width, 3) of the pixels, grey levels."""

    mean: FloatArray
    deviation: FloatArray

    def __post_init__(self) -> None:
        if self.mean.shape != self.deviation.shape or self.mean.shape[2:] != (3,):
            raise CaptureError(
                f"mean {self.mean.shape} and deviation {self.deviation.shape} are not colour images of the same size",
                where="background",
                advice="learn the background again",
            )

    @property
    def image_size(self) -> tuple[int, int]:
        """Width and height, pixels."""
        return self.mean.shape[1], self.mean.shape[0]

    @property
    def noise(self) -> float:
        """Typical standard deviation of a pixel, grey levels."""
        return float(np.median(self.deviation[::4, ::4]))

    def band(self, sigmas: float, threshold: float) -> tuple[Image, Image]:
        """Return the lowest and highest background value of each pixel and channel.

        A pixel may differ by `threshold` grey levels or by `sigmas` of its standard deviations, whichever is more.
        """
        reach = np.maximum(sigmas * self.deviation, threshold)
        low = np.ceil(np.clip(self.mean - reach, 0.0, 255.0)).astype(np.uint8)
        high = np.floor(np.clip(self.mean + reach, 0.0, 255.0)).astype(np.uint8)
        return low, high


class BackgroundLearner:
    """Running mean and standard deviation over frames without the performer."""

    def __init__(self) -> None:
        self._count = 0
        self._sum: Array | None = None
        self._squares: Array | None = None

    def add(self, image: Image) -> None:
        """Add a frame (height, width, 3); all frames have the same size."""
        if self._sum is None or self._squares is None:
            self._sum, self._squares = np.zeros(image.shape), np.zeros(image.shape)
        if image.shape != self._sum.shape:
            what = f"the images changed size from {self._sum.shape} to {image.shape}"
            raise CaptureError(what, advice="learn the background from images of one size")
        cv2.accumulate(image, self._sum)
        cv2.accumulateSquare(image, self._squares)
        self._count += 1

    def result(self) -> Background:
        """Return the background learned from at least two frames."""
        if self._count < 2 or self._sum is None or self._squares is None:
            raise CaptureError(
                f"the background cannot be learned from {counted(self._count, 'frame')}",
                advice="let the cameras run for a second or two without the performer",
            )
        mean = self._sum / self._count
        variance = np.maximum(self._squares / self._count - mean**2, 0.0) * self._count / (self._count - 1)
        return Background(mean.astype(np.float32), np.sqrt(variance).astype(np.float32))


def learn_backgrounds(moments: Iterable[Sequence[Image]]) -> list[Background]:
    """Return each camera's background from any number of moments without the performer."""
    learners: list[BackgroundLearner] = []
    for images in moments:
        learners = learners or [BackgroundLearner() for _ in images]
        for learner, image in zip(learners, images, strict=True):
            learner.add(image)
    return [learner.result() for learner in learners or [BackgroundLearner()]]


def background_from_take(samples: Sequence[Image]) -> Background:
    """Return the background from frames spread over a take with the performer in it.

    Markers are brighter than the background and move, so the darkest 60 % of a pixel's values are background: a marker
    may cover it for 40 % of the take.
    """
    if len(samples) < 2:
        what = f"the background cannot be learned from {counted(len(samples), 'frame')}"
        raise CaptureError(what, advice="give frames from the whole take")
    stack = np.sort(np.stack(samples), axis=0)
    kept = stack[: max(2, round(0.6 * len(stack)))].astype(np.float32)
    # cutting off the upper 40 % leaves 0.70 of a normal distribution's standard deviation
    return Background(kept.mean(axis=0), kept.std(axis=0) / np.float32(0.70))
