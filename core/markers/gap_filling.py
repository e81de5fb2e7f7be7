"""Gap filling with the solved body and with splines.

In the frame of the joint that carries it, a marker moves only because of skin motion and calibration errors. This
position is interpolated across a gap, and the solved joint carries it along. In short gaps, a cubic spline through the
positions next to the gap is better. The two estimates are averaged, weighted by the inverse of their expected squared
errors. The spline's error is measured on artificial gaps where the marker is visible. The body's error is estimated
from the change of the marker's position on the body across gaps, with the body solved without this marker.
"""

from dataclasses import dataclass, replace

import numpy as np

from ..body.motion import Motion
from ..body.skeleton import forward_kinematics
from ..geometry import rotations as rot
from ..geometry.arrays import Array, IntArray, Mask, runs
from ..geometry.cubic_curves import cubic_spline
from .marker_set import MarkerSet
from .marker_take import MarkerTake
from .steady_take import frame_times

_MID_ERROR = 0.0398  # RMS of u^2 (1 - u)^2, the shape of a cubic interpolation's error over a gap


@dataclass(frozen=True)
class GapSettings:
    """Settings of `fill_gaps`, chosen on artificial gaps in CMU takes (tuning log)."""

    shoulder_s: float = 0.1  # length of trajectory on either side of a gap that is used
    settled_s: float = 0.04  # time constant with which the offset in the frame next to the gap fades
    leaving_s: float = 0.1  # time constant with which the body's error grows away from the gap's ends
    least_drift_m: float = 0.01  # drift of a marker on the body across a gap, used if few gaps show it
    earlier_gaps: float = 3.0  # weight of the mean drift over all gaps relative to that of the gap itself
    least_error_m: float = 0.001  # smallest error assumed for either estimate
    long_s: float = 0.5  # length of a gap for which the measured error of splines is doubled, because motions differ
    most_trials: int = 40  # largest number of artificial gaps on which splines are measured


_S = GapSettings()


@dataclass(frozen=True)
class Gap:
    """Gap in the trajectory of a marker (column of the take), from frame `start` up to but not including `stop`."""

    marker: int
    start: int
    stop: int

    @property
    def frames(self) -> int:
        """Number of frames."""
        return self.stop - self.start


def find_gaps(visible: Mask) -> list[Gap]:
    """Return the gaps in a mask (F, M) of visible markers; markers that are never visible have none."""
    found = []
    for marker, seen in enumerate(visible.T):
        if seen.any():
            found += [Gap(marker, start, stop) for start, stop in runs(~seen)]
    return found


def widen_gaps(take: MarkerTake) -> MarkerTake:
    """Return the take with each gap a tenth of a second longer at both ends.

    A body solved from this take does not jump where a marker disappears or returns, and next to the gap the marker
    shows how far off the body is without it.
    """
    frames = _shoulder(take.fps)
    kept = take.visible
    for gap in find_gaps(take.visible):
        kept[max(0, gap.start - frames) : gap.stop + frames, gap.marker] = False
    return replace(take, positions_m=np.where(kept[..., None], take.positions_m, np.nan))


def fill_gaps(take: MarkerTake, marker_set: MarkerSet, motion: Motion) -> MarkerTake:
    """Fill the gaps of a set's markers; measured positions are kept.

    Args:
        take: Take with the set's marker names; other markers, and those never visible, are unchanged.
        motion: Motion solved from `widen_gaps` of the take, in its world, with the same frames.
    """
    joints, turns = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)
    times_s = frame_times(take)
    carriers = {marker.name: motion.skeleton.index(marker.joint) for marker in marker_set.markers}
    gaps = [gap for gap in find_gaps(take.visible) if take.names[gap.marker] in carriers]
    fillers = [_Filler(take, times_s, gap, joints, turns, carriers[take.names[gap.marker]]) for gap in gaps]
    drifts = np.array([filler.drift_m for filler in fillers])
    drifts = drifts[np.isfinite(drifts)]
    usual = np.sqrt(np.mean(np.square([*drifts, _S.least_drift_m])))
    positions = take.positions_m.copy()
    for gap, filler in zip(gaps, fillers, strict=True):
        positions[gap.start : gap.stop, gap.marker] = filler.fill(float(usual))
    return replace(take, positions_m=positions)


def _shoulder(fps: float) -> int:
    return max(2, round(_S.shoulder_s * fps))


class _Filler:
    """Fills one gap from the measured positions next to it."""

    def __init__(self, take: MarkerTake, times_s: Array, gap: Gap, joints: Array, turns: Array, carrier: int) -> None:
        self._fps, self._times_s, self._gap = take.fps, times_s, gap
        self._path = take.positions_m[:, gap.marker]
        self._seen = np.isfinite(self._path[:, 0])
        near = slice(max(0, gap.start - _shoulder(take.fps)), gap.stop + _shoulder(take.fps))
        rows = np.arange(len(self._path))[near]
        self._before = rows[(rows < gap.start) & self._seen[near]]
        self._after = rows[(rows >= gap.stop) & self._seen[near]]
        self._joint, self._turn = joints[:, carrier], turns[:, carrier]

    @property
    def drift_m(self) -> float:
        """Change of the marker's position on the body across the gap; NaN at the take's beginning or end."""
        if not len(self._before) or not len(self._after):
            return float("nan")
        return float(np.linalg.norm(self._place(self._before).mean(axis=0) - self._place(self._after).mean(axis=0)))

    def _place(self, rows: IntArray) -> Array:
        """Return the marker's positions (n, 3) in its joint's frame in some frames (n,)."""
        return rot.rotate(rot.conjugate(self._turn[rows]), self._path[rows] - self._joint[rows])

    def fill(self, usual_drift_m: float) -> Array:
        """Return positions (n, 3) for the gap's frames."""
        body = self._by_body()
        rows = np.concatenate((self._before, self._after))
        tried = self._tried_m()
        if tried is None or len(self._before) < 2 or len(self._after) < 2:
            return body
        hidden_s, span_s = self._hidden_s()
        spline = cubic_spline(self._times_s[rows], self._path[rows], hidden_s)
        own = np.square(self.drift_m) + _S.earlier_gaps * usual_drift_m**2
        # the variance of the difference of two positions is twice that of one
        drift = np.sqrt(0.5 * own / (1.0 + _S.earlier_gaps))
        share = (hidden_s - span_s[0]) / (span_s[1] - span_s[0])
        from_end_s = np.minimum(hidden_s - span_s[0], span_s[1] - hidden_s)
        body_error = drift * (1.0 - np.exp(-from_end_s / _S.leaving_s)) + _S.least_error_m
        distrust = 1.0 + ((hidden_s[-1] - hidden_s[0] + 1.0 / self._fps) / _S.long_s) ** 2
        spline_error = distrust * tried * (share * (1.0 - share)) ** 2 / _MID_ERROR + _S.least_error_m
        weight = (body_error**2 / (body_error**2 + spline_error**2))[:, None]
        return np.asarray(weight * spline + (1.0 - weight) * body)

    def _hidden_s(self) -> tuple[Array, tuple[float, float]]:
        """Return the times of the gap's frames, and of the frames before and after it."""
        start, stop = self._gap.start, self._gap.stop
        hidden_s = self._times_s[start:stop]
        before_s = self._times_s[start - 1] if start > 0 else hidden_s[0] - 1.0 / self._fps
        after_s = self._times_s[stop] if stop < len(self._times_s) else hidden_s[-1] + 1.0 / self._fps
        return hidden_s, (float(before_s), float(after_s))

    def _by_body(self) -> Array:
        """Return positions (n, 3) carried along by the solved joint, without a jump at the ends of the gap."""
        hidden_s, (start_s, stop_s) = self._hidden_s()
        since_s, until_s = (hidden_s - start_s)[:, None], (stop_s - hidden_s)[:, None]
        ends = [rows for rows in (self._before, self._after) if len(rows)]
        first, last = (self._place(rows).mean(axis=0) for rows in (ends[0], ends[-1]))
        places = first + (last - first) * since_s / (stop_s - start_s)
        if len(self._before):
            places = places + (self._place(self._before[-1:]) - first) * np.exp(-since_s / _S.settled_s)
        if len(self._after):
            places = places + (self._place(self._after[:1]) - last) * np.exp(-until_s / _S.settled_s)
        rows = slice(self._gap.start, self._gap.stop)
        return np.asarray(self._joint[rows] + rot.rotate(self._turn[rows], places))

    def _tried_m(self) -> float | None:
        """Return the RMS error of splines over artificial gaps of this length; None if there is no room for any."""
        count, beside = self._gap.frames, _shoulder(self._fps)
        length = count + 2 * beside
        whole = np.convolve(self._seen, np.ones(length, dtype=int), mode="valid") == length
        starts = np.flatnonzero(whole)
        if len(self._path) < length or not len(starts):
            return None
        rows = np.arange(length)
        hidden, kept = rows[beside : beside + count], np.delete(rows, np.s_[beside : beside + count])
        # one spline for all artificial gaps, because they share their knots
        paths = self._path[starts[:: max(1, len(starts) // _S.most_trials)] + rows[:, None]]
        away = cubic_spline(kept.astype(np.float64), paths[kept], hidden.astype(np.float64)) - paths[hidden]
        return float(np.sqrt(np.mean(np.sum(away**2, axis=-1))))
