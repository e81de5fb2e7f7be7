"""Time offsets between films that were not started together, from the motion of the person in them.

The rays of a body's points meet only at the right offset. All offsets are tried; each is worth how well the points keep
their epipolar lines at it, in nats, counted as if only some of a person's points had errors of their own. Unlike the
blobs of `matching.time_offset.estimate_time_offset`, points have names, errors of centimetres, and no rough offset. If
the cameras' poses are unknown, those that most points agree on at an offset are taken (Nister 2004).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...errors import CaptureError
from ...geometry.arrays import Array, FloatArray, IntArray, Mask, median_of_known
from ...geometry.camera import Camera
from ...markers.marker_frame import MarkerFrame
from ...markers.marker_set import MarkerSet
from ..calibration.two_view_start import place_two
from ..matching.stereo import essential_matrix, homogeneous
from ..matching.time_offset import TimeOffset
from .people_pipeline import LocateSettings
from .side_exchanges import SideExchanges


@dataclass(frozen=True)
class ClockSettings:
    """Settings of `person_offsets` and `at_one_time`."""

    smooth_s: float = 0.15  # time over which points are averaged
    compared_s: float = 0.1  # time between the moments that are compared
    common: float = 0.4  # smallest share of the shorter film that both films show
    placed_step_s: float = 0.4  # step between offsets at which cameras with unknown poses are placed
    grid_step_s: float = 0.04  # step between the offsets that are tried first
    fine_step_s: float = 0.002  # step between those near the best one
    fine_s: float = 0.1  # largest distance of these from it
    peak_s: float = 0.3  # distance from the best offset from which an offset is another one
    best_placed: int = 3  # number of offsets at which cameras are placed again
    placing_points: int = 200  # number of points that place cameras
    chance: float = 10.0  # distance from its epipolar line, in standard deviations, at which a point tells nothing
    independent: float = 10.0  # number of a person's points that have errors of their own
    independent_s: float = 0.3  # time after which a point's error is another one
    agreeing: float = 3.0  # distance from its epipolar line, in standard deviations, at which a point agrees
    least_agreeing: float = 0.65  # smallest share of points that agree
    evidence: float = 6.0  # least evidence for the best offset against any other one, nats
    largest_sigma_s: float = 0.018  # largest standard deviation of an offset that is used: half a picture at 30 Hz
    least_scale: float = 0.2  # smallest error of the points, in units of what the network's pictures let expect
    longest_gap_s: float = 0.15  # longest time between two pictures between which points are interpolated


_S, _LOCATE = ClockSettings(), LocateSettings()
_SAME = "give films of the same motion in which the person walks about for 10 s or more, or cut them to begin together"


def synchronise_person(
    cameras: Sequence[Camera], frames: Sequence[MarkerFrame], points: MarkerSet, *, placed: bool
) -> tuple[list[MarkerFrame], tuple[TimeOffset, ...]]:
    """Return frames with the pictures of all cameras at the same moments, and the cameras' time offsets.

    If the frames hold pictures of several cameras, they are returned unchanged unless an offset of more than half a
    picture's time is found.

    Args: as for `person_offsets`.

    Raises:
        CaptureError: Each frame holds the picture of one camera, and the motion does not determine an offset.
    """
    offsets = person_offsets(cameras, frames, points, placed=placed)
    if any(np.count_nonzero(np.isfinite(frame.camera_times_s)) > 1 for frame in frames):
        period_s = float(np.median(np.diff([frame.time_s for frame in frames]))) if len(frames) > 1 else 0.0
        offsets = tuple(each if abs(each.offset_s) > 0.5 * period_s else TimeOffset() for each in offsets)
        if not any(each.is_found for each in offsets):
            return list(frames), offsets
    elif lost := [camera.name for camera, each in zip(cameras, offsets, strict=True) if not each.is_found]:
        what = f"when {' and '.join(lost)} began to film cannot be told from the motion that {cameras[0].name} shows"
        raise CaptureError(what, advice=_SAME)
    return at_one_time(cameras, frames, points, [each.offset_s for each in offsets]), offsets


def person_offsets(
    cameras: Sequence[Camera], frames: Sequence[MarkerFrame], points: MarkerSet, *, placed: bool
) -> tuple[TimeOffset, ...]:
    """Return each camera's time offset relative to the first; without a result where the motion does not determine it.

    Args:
        frames: What `PeoplePipeline.detect` returned; a frame holds the pictures of all cameras, or of some.
        points: The network's points.
        placed: Whether the poses of the cameras are known.
    """
    films = [_Film.of(frames, index, camera, points) for index, camera in enumerate(cameras)]
    return (TimeOffset(sigma_s=0.0), *(_Pair(films[0], film, placed=placed).offset() for film in films[1:]))


@dataclass(frozen=True)
class _Film:
    """What a camera shows of a person at times (F,): normalised points (F, K, 2), standard deviations (F,)."""

    camera: Camera
    times_s: Array
    points: Array
    sigmas: Array

    @classmethod
    def of(cls, frames: Sequence[MarkerFrame], index: int, camera: Camera, points: MarkerSet) -> "_Film":
        times_s, rows = camera_rows(frames, index, len(points))
        pixels = np.where(rows[..., 3:4] >= 255.0 * _LOCATE.least_visible, rows[..., :2], np.nan)
        smooth = _smoothed(times_s, camera.undistort(pixels))
        return cls(camera, times_s, smooth, np.median(rows[..., 2], axis=1) / camera.focal_px)

    def at(self, moments_s: Array) -> Array:
        """Return the points (N, K, 2) at other times, NaN where unknown."""
        before, share, known = _between(self.times_s, moments_s)
        found = self.points[before] + share[:, None, None] * (self.points[before + 1] - self.points[before])
        return np.where(known[:, None, None], found, np.nan)

    def thin(self) -> "_Film":
        """Return the film with the moments that are compared."""
        step = max(1, round(_S.compared_s / float(np.median(np.diff(self.times_s)))))
        return replace(self, times_s=self.times_s[::step], points=self.points[::step], sigmas=self.sigmas[::step])


class _Pair:
    """Two films of a person, compared at offsets of the second."""

    def __init__(self, first: _Film, second: _Film, *, placed: bool) -> None:
        self._is_empty = min(len(first.times_s), len(second.times_s)) < 2
        if self._is_empty:
            return
        self._a, self._b = first.thin(), second
        self._sigma = 0.5 * float(np.median(first.sigmas) + np.median(second.sigmas))
        elapsed_s = float(np.median(np.diff(self._a.times_s)))
        self._share = _S.independent / first.points.shape[1] * min(1.0, elapsed_s / _S.independent_s)
        self._essential = essential_matrix(first.camera, second.camera) if placed else None

    def offset(self) -> TimeOffset:
        """Return the offset with the most evidence, without a result if another one is nearly as good."""
        if self._is_empty:
            return TimeOffset()
        grid = self._grid(_S.grid_step_s)
        essential = self._essential if self._essential is not None else self._placed()
        if essential is None or len(grid) == 0:
            return TimeOffset()
        costs, counts = _costs([self._distances(essential, each) for each in grid.tolist()])
        best = int(np.argmax(self._evidence(costs, counts)))
        about_s, others = float(grid[best]), np.abs(grid - grid[best]) > _S.peak_s
        # of the mean costs: how long the films overlap at an offset must not count
        margins = self._share * np.minimum(counts, counts[best]) * (costs - costs[best])
        margin = float(margins[others].min(initial=np.inf))
        offset_s, sigma_s, agreeing = self._refined(essential, about_s)
        if margin < _S.evidence or sigma_s > _S.largest_sigma_s or agreeing < _S.least_agreeing:
            return TimeOffset()
        return TimeOffset(offset_s, sigma_s=sigma_s, samples=len(self._a.times_s))

    def _refined(self, essential: Array, about_s: float) -> tuple[float, float, float]:
        """Return the offset near one with the least cost, its standard deviation, and the share of agreeing points.

        Points that miss each other less than expected determine it better.
        """
        near = about_s + np.arange(-_S.fine_s, _S.fine_s + 1e-9, _S.fine_step_s)
        steady = [each - median_of_known(each) for each in (self._distances(essential, s) for s in near.tolist())]
        missed = [float(np.nanmedian(np.abs(each))) if np.isfinite(each).any() else np.inf for each in steady]
        scale = float(np.clip(1.4826 * min(missed), _S.least_scale, 1.0))
        costs, counts = _costs([each / scale for each in steady])
        best = int(np.argmin(costs))
        bend = self._share * counts[best] * np.polyfit(near - near[best], costs, 2)[0]
        sigma_s = float(1.0 / np.sqrt(2.0 * bend)) if bend > 0.0 else np.inf
        distances = self._distances(essential, float(near[best]))
        agreeing = np.count_nonzero(np.abs(distances) < _S.agreeing) / max(int(counts[best]), 1)
        return float(near[best]), sigma_s, agreeing

    def _grid(self, step_s: float) -> Array:
        """Return the offsets at which the films have enough in common."""
        a, b = self._a.times_s, self._b.times_s
        common_s = _S.common * min(float(np.ptp(a)), float(np.ptp(b)))
        return np.arange(a[0] - b[-1] + common_s, a[-1] - b[0] - common_s, step_s)

    def _distances(self, essential: Array, offset_s: float) -> Array:
        """Return the distances (F, K) of the points from their epipolar lines, in standard deviations (Sampson)."""
        x, y = homogeneous(self._a.points), homogeneous(self._b.at(self._a.times_s - offset_s))
        lines, back = x @ essential.T, y @ essential
        slope = np.sum(lines[..., :2] ** 2, axis=-1) + np.sum(back[..., :2] ** 2, axis=-1)
        return np.asarray(np.sum(lines * y, axis=-1) / np.sqrt(np.maximum(slope, 1e-30)) / self._sigma)

    def _evidence(self, costs: Array, counts: Array) -> Array:
        """Return the evidence (n,) for offsets, nats: how much better than by chance points keep their lines."""
        return np.asarray(self._share * counts * (np.log1p(_S.chance**2) - costs))

    def _placed(self) -> Array | None:
        """Return the essential matrix at the offset where one has the most evidence."""
        grid = self._grid(_S.placed_step_s)
        near = np.arange(-0.5 * _S.placed_step_s, 0.5 * _S.placed_step_s, _S.grid_step_s)
        tried = [each for offset_s in grid if (each := self._placed_at(float(offset_s), near))]
        tried = sorted(tried, key=lambda each: -each[0])[: _S.best_placed]
        for _ in range(2):
            tried += [again for each in tried if (again := self._placed_at(each[1], near))]
            tried = sorted(tried, key=lambda each: -each[0])[: _S.best_placed]
        return tried[0][2] if tried else None

    def _placed_at(self, offset_s: float, near: Array) -> tuple[float, float, Array] | None:
        """Return the evidence for the best offset near one at which the cameras are placed, it, and the matrix."""
        points = self._b.at(self._a.times_s - offset_s)
        found = place_two(self._a.points.reshape(-1, 2), points.reshape(-1, 2), self._sigma, _S.placing_points)
        if found is None:
            return None
        first = replace(self._a.camera, rotation=np.eye(3), translation_m=np.zeros(3))
        second = replace(self._b.camera, rotation=found.rotation, translation_m=found.translation)
        essential = essential_matrix(first, second)
        evidence = self._evidence(*_costs([self._distances(essential, offset_s + each) for each in near.tolist()]))
        best = int(np.argmax(evidence))
        return float(evidence[best]), float(offset_s + near[best]), essential


def _costs(distances: Sequence[Array]) -> tuple[Array, Array]:
    """Return the mean cost (n,) of each set of distances (F, K), NaN where unknown (Cauchy's loss), and their numbers.

    A distance as large as by chance costs no less than an unknown one.
    """
    costs, counts = np.full(len(distances), np.log1p(_S.chance**2)), np.zeros(len(distances))
    for row, each in enumerate(distances):
        known = each[np.isfinite(each)]
        counts[row] = len(known)
        if len(known):
            costs[row] = np.minimum(np.log1p(known**2), costs[row]).mean()
    return costs, counts


def _smoothed(times_s: Array, points: Array) -> Array:
    """Return the means of the points within a short time.

    Without, the offsets that fall between two pictures would win, because interpolation halves the noise there.
    """
    if len(times_s) < 2:
        return points
    half = max(1, round(0.5 * _S.smooth_s / float(np.median(np.diff(times_s)))))
    padded = np.pad(points, ((half, half), (0, 0), (0, 0)), constant_values=np.nan)
    near = np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1, axis=0)
    known = np.isfinite(near)
    means = np.where(known, near, 0.0).sum(axis=-1) / np.maximum(known.sum(axis=-1), 1)
    return np.where(np.isfinite(points), means, np.nan)


def camera_rows(frames: Sequence[MarkerFrame], camera: int, count: int) -> tuple[Array, Array]:
    """Return the times (n,) at which a camera shows a person, and the `count` points' rows (n, count, 5)."""
    shown = [frame for frame in frames if len(frame.detected[camera]) == count]
    times_s = np.array([frame.camera_times_s[camera] for frame in shown])
    return times_s, np.array([frame.detected[camera] for frame in shown], dtype=np.float64).reshape(-1, count, 5)


def _between(times_s: Array, moments_s: Array) -> tuple[IntArray, Array, Mask]:
    """Return the last time before each moment, the share of the way to the next, and whether both are near."""
    before = np.clip(np.searchsorted(times_s, moments_s, side="right") - 1, 0, len(times_s) - 2)
    spans_s = times_s[before + 1] - times_s[before]
    share = (moments_s - times_s[before]) / spans_s
    inside = (moments_s >= times_s[0] - _S.fine_step_s) & (moments_s <= times_s[-1] + _S.fine_step_s)
    return before, np.clip(share, 0.0, 1.0), inside & (spans_s <= _S.longest_gap_s)


def at_one_time(
    cameras: Sequence[Camera], frames: Sequence[MarkerFrame], points: MarkerSet, offsets_s: Sequence[float]
) -> list[MarkerFrame]:
    """Return frames with all cameras' points at the moments of the slowest camera, from the first that all show.

    Args:
        cameras, frames, points: As for `person_offsets`.
        offsets_s: Time offset of each camera.
    """
    films = [camera_rows(frames, index, len(points)) for index in range(len(cameras))]
    shown_s = [times_s + offset_s for (times_s, _), offset_s in zip(films, offsets_s, strict=True)]
    if min(map(len, shown_s)) < 2:
        return []
    slowest = int(np.argmax([round(float(np.median(np.diff(times_s))), 4) for times_s in shown_s]))
    stamps_s = np.array([frame.camera_times_s for frame in frames]) + offsets_s
    start_s = max(times_s[0] for times_s in shown_s) - _S.fine_step_s
    end_s = min(times_s[-1] for times_s in shown_s) + _S.fine_step_s
    moments_s = stamps_s[:, slowest][(stamps_s[:, slowest] >= start_s) & (stamps_s[:, slowest] <= end_s)]
    rows = zip(cameras, shown_s, films, strict=True)
    seen = [_moved(camera, times_s, found, points, moments_s) for camera, times_s, (_, found) in rows]
    nearest = [np.nanargmin(np.abs(stamps_s - each), axis=0) for each in moments_s]
    moments = []
    for number, (blobs, time_s) in enumerate(zip(zip(*seen, strict=True), moments_s - moments_s[:1], strict=True)):
        times_s = np.where([len(each) > 0 for each in blobs], time_s, np.nan)
        notes = dict.fromkeys(note for row in nearest[number] for note in frames[row].notes)
        moments.append(MarkerFrame(number, float(time_s), blobs=blobs, camera_times_s=times_s, notes=tuple(notes)))
    return moments


def _moved(camera: Camera, times_s: Array, rows: Array, points: MarkerSet, moments_s: Array) -> list[FloatArray]:
    """Return a camera's rows (K, 5) at each moment, with the sides of the nearest picture; none without one nearby.

    Points are interpolated with sides that do not change in between (see `SideExchanges`).
    """
    normalised = camera.undistort(rows[..., :2])[:, None]
    of_point = SideExchanges((camera,), points.markers).decide_all(times_s, normalised)[:, 0, :, None]
    steady = np.take_along_axis(rows, of_point, axis=1)
    before, share, known = _between(times_s, moments_s)
    nearest = before + (share > 0.5)
    between = steady[before] + share[:, None, None] * (steady[before + 1] - steady[before])
    moved = np.take_along_axis(between, of_point[nearest], axis=1)  # exchanging twice is not exchanging
    return [row if is_known else row[:0] for row, is_known in zip(moved.astype(np.float32), known, strict=True)]
