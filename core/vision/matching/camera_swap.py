"""Detection of images that do not belong to their cameras: exchanged, mirrored or upside down."""

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from ...geometry.arrays import FloatArray
from ...geometry.camera import CameraRig
from .matching_settings import MATCHING
from .stereo import Matches, StereoMatcher

_EXCHANGED = "the left and the right camera seem to be exchanged"

_Flip: TypeAlias = tuple[int, int]  # signs along and across an image's rows
_STRAIGHT: _Flip = (1, 1)
_MIRRORED: _Flip = (-1, 1)
_TURNED: _Flip = (-1, -1)
_HOW = {_MIRRORED: "mirrored", _TURNED: "turned upside down"}


@dataclass(frozen=True)
class ImageMismatch:
    """A change of the images that would make them fit; each camera's image has its own flip."""

    note: str
    flips: tuple[_Flip, _Flip] = (_STRAIGHT, _STRAIGHT)
    is_exchange: bool = False


class CameraSwapDetector:
    """Test of two cameras' images, run while their blobs match badly; other numbers of cameras are not tested."""

    def __init__(self, rig: CameraRig) -> None:
        self._mismatches = image_mismatches(rig)
        self._sizes = [camera.image_size for camera in rig.cameras]
        self._matchers = (
            [] if len(rig) != 2 else [StereoMatcher(CameraRig(cameras)) for cameras in (rig.cameras, rig.cameras[::-1])]
        )
        # mean errors for each possible mismatch, with the images as they are and as they would be without it
        self._errors_px = [deque[tuple[float, float]](maxlen=MATCHING.swap_frames) for _ in self._mismatches]
        self._turn = 0

    def update(self, blobs: Sequence[FloatArray], matches: Matches) -> ImageMismatch | None:
        """Return what seems to be wrong with the images, or None."""
        seen = min(len(rows) for rows in blobs)
        if self._mismatches and seen >= MATCHING.fewest_blobs:
            error = self._error_px(matches, seen)
            # An exchange is frequent, so it is tested every time. The others are tested in turn, because a test takes
            # as long as the matching itself.
            self._turn = self._turn % (len(self._mismatches) - 1) + 1
            for tried in (0, self._turn):
                is_bad = error > MATCHING.swap_px
                changed = self._changed_error_px(self._mismatches[tried], blobs, seen) if is_bad else error
                self._errors_px[tried].append((error, changed))
        full = [(at, pairs) for at, pairs in enumerate(self._errors_px) if len(pairs) == pairs.maxlen]
        found = [(*np.mean(pairs, axis=0).tolist(), at) for at, pairs in full]
        clear = [
            (changed, at)
            for error, changed, at in found
            if error > MATCHING.swap_px and changed < MATCHING.swap_gain * error
        ]
        return self._mismatches[min(clear)[1]] if clear else None

    def _changed_error_px(self, mismatch: ImageMismatch, blobs: Sequence[FloatArray], seen: int) -> float:
        flipped = [_flipped(*each) for each in zip(blobs, self._sizes, mismatch.flips, strict=True)]
        matcher = self._matchers[mismatch.is_exchange]
        return self._error_px(matcher.match(flipped, matcher.undistort(flipped), None), seen)

    def _error_px(self, matches: Matches, seen: int) -> float:
        """Return the mean reprojection error of blobs, pixels; an unmatched blob adds the largest error."""
        unmatched = seen - len(matches.points_m)
        return float(matches.errors_px.mean(axis=1).sum() + MATCHING.epipolar_px * unmatched) / seen


def image_mismatches(rig: CameraRig) -> tuple[ImageMismatch, ...]:
    """Return all possible mismatches of two cameras' images; none for other numbers of cameras."""
    if len(rig) != 2:
        return ()
    found = [ImageMismatch(_EXCHANGED, is_exchange=True)]
    first, second = (camera.name for camera in rig.cameras)
    for flip, how in _HOW.items():
        found += [
            ImageMismatch(f"the images of camera {first} seem to be {how}", (flip, _STRAIGHT)),
            ImageMismatch(f"the images of camera {second} seem to be {how}", (_STRAIGHT, flip)),
            ImageMismatch(f"the images of both cameras seem to be {how}", (flip, flip)),
        ]
    return tuple(found)


def _flipped(blobs: FloatArray, size: tuple[int, int], flip: _Flip) -> FloatArray:
    """Return blobs (N, 2 or more) with their pixels as in a flipped image."""
    if flip == _STRAIGHT:
        return blobs
    changed = blobs.copy()
    for axis, sign in enumerate(flip):
        if sign < 0:
            changed[:, axis] = size[axis] - 1 - blobs[:, axis]
    return changed
