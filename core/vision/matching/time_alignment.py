"""Alignment in time of the blobs of unsynchronised cameras, along their tracks."""

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...geometry.arrays import Array, FloatArray, IntArray
from ...geometry.camera import CameraRig
from .image_tracks import BlobLinker
from .matching_settings import MATCHING
from .time_offset import TimeOffset


@dataclass(frozen=True)
class _Seen:
    """Blobs (n, 5) of one image, their tracks (n,), and the time that the image shows."""

    moment_s: float
    blobs: FloatArray
    ids: IntArray


class TimeAligner:
    """Alignment of each camera's blobs to the earliest moment of its image set, so that no later image is needed."""

    def __init__(self, rig: CameraRig, offsets: Sequence[TimeOffset]) -> None:
        self.offsets = tuple(offsets)
        self._linkers = [BlobLinker(camera.image_size[0]) for camera in rig.cameras]
        self._last_s = -np.inf
        self._seen: list[deque[_Seen]] = [deque(maxlen=MATCHING.remembered_images) for _ in rig.cameras]

    def align(
        self, time_s: float, stamps_s: Array, blobs: Sequence[FloatArray]
    ) -> tuple[float, tuple[FloatArray, ...]]:
        """Return the common moment and the blobs (n, 5) of each camera at that moment.

        Args:
            time_s: Time of the images if none has a stamp.
            stamps_s: Time stamps (C,) of the images; NaN where a camera gave none.
        """
        stamps = stamps_s.tolist()
        there = [math.isfinite(stamp) for stamp in stamps]
        usual_s = time_s if all(there) or not any(there) else float(np.nanmean(stamps_s))
        expected = [stamp if new else usual_s for stamp, new in zip(stamps, there, strict=True)]
        moments = [offset.moment_s(stamp) for offset, stamp in zip(self.offsets, expected, strict=True)]
        for seen, linker, moment_s, rows, new in zip(self._seen, self._linkers, moments, blobs, there, strict=True):
            if new and (not seen or moment_s > seen[-1].moment_s):
                seen.append(_Seen(moment_s, rows, linker.link(moment_s, rows[:, :2].astype(np.float64))))
        common_s = min(moments)
        if 0.0 <= self._last_s - common_s < MATCHING.largest_step_s:
            common_s = self._last_s + MATCHING.least_step_s
        self._last_s = common_s
        at = [
            _blobs_at(seen, common_s) if new else np.empty((0, 5), dtype=np.float32)
            for seen, new in zip(self._seen, there, strict=True)
        ]
        return common_s, tuple(at)


def _blobs_at(seen: Sequence[_Seen], moment_s: float) -> FloatArray:
    """Return the blobs of the image nearest to a moment, moved along their tracks."""
    order = _nearest(seen, moment_s)
    if order and order[0].moment_s == moment_s:
        return order[0].blobs
    if len(order) < 2:
        return np.empty((0, 5), dtype=np.float32)
    nearest, period_s = order[0], abs(order[1].moment_s - order[0].moment_s)
    if abs(nearest.moment_s - moment_s) > MATCHING.reach_periods * period_s:
        return np.empty((0, 5), dtype=np.float32)
    known = np.stack([_of_tracks(image, nearest.ids) for image in order])
    moments = np.array([image.moment_s for image in order])
    shown = np.isfinite(known[..., 0])
    use = shown & (np.cumsum(shown, axis=0) <= MATCHING.parabola_images)
    rows = nearest.blobs.copy()
    left = np.ones(len(rows), dtype=bool)
    while left.any():  # blobs with the same images are processed together, which usually means all of them
        pattern = use[:, left.argmax()]
        alike = left & np.all(use == pattern[:, None], axis=0)
        times = moments[pattern].tolist()
        weights = [math.prod((moment_s - other) / (own - other) for other in times if other != own) for own in times]
        rows[alike, :2] = np.tensordot(weights, known[pattern][:, alike], axes=1)
        left &= ~alike
    return rows


def _nearest(seen: Sequence[_Seen], moment_s: float) -> list[_Seen]:
    """Return the images nearest to a moment, the nearest first."""
    last = len(seen) - 1
    while last > 0 and seen[last].moment_s > moment_s:
        last -= 1
    count = MATCHING.nearest_images
    around = [seen[i] for i in range(max(last - count, 0), min(last + count, len(seen)))]
    return sorted(around, key=lambda image: abs(image.moment_s - moment_s))[:count]


def _of_tracks(image: _Seen, ids: IntArray) -> Array:
    """Return the positions (n, 2) of tracks in an image, NaN where they are missing."""
    if image.ids is ids:
        return image.blobs[:, :2].astype(np.float64)
    points = np.full((len(ids), 2), np.nan)
    rows, columns = np.nonzero(ids[:, None] == image.ids)
    points[rows] = image.blobs[columns, :2]
    return points
