"""Faulty labels of a take: exchanged markers, frozen stretches, wild points.

A label is trusted while its trajectory moves as a body can. Exchanged labels are corrected; positions with other faults
are removed. Both directions of time are used, so this works on complete takes only.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from ..body.scene_pose import DoubtfulStretch
from ..geometry.arrays import Array, IntArray, Mask, runs
from .exchanged_labels import Exchange, put_back, undo_exchanges
from .exchanged_sides import exchanged_sides
from .exchanged_throughout import exchanged_throughout
from .frozen_markers import STILL_M
from .marker_noise import MEDIAN_LENGTH
from .marker_take import MarkerTake, SingleViews
from .source_noise import noise_of
from .subject import Subject
from .trajectory_seams import SeamScale, after, before, cost
from .wild_points import find_wild_points


class FaultKind(Enum):
    """What is wrong with labels."""

    EXCHANGED = "exchanged"
    SIDES = "sides"  # all left with all right labels, in the whole take, which may be mirrored instead
    FROZEN = "frozen"
    WILD = "wild"


_WHAT = {
    FaultKind.EXCHANGED: "had each other's labels, corrected",
    FaultKind.SIDES: "had each other's labels, corrected; or the take is a mirror image, and then so is the motion",
    FaultKind.FROZEN: "stood still while the body moved, treated as missing",
    FaultKind.WILD: "jumped away and back, treated as missing",
}


_TOLD = 8  # largest number of stretches that warnings list


@dataclass(frozen=True)
class LabelFault:
    """Frames of a take in which labels were wrong.

    Args:
        first, last: Frames of the take, counted from 0, including the last.
        labels: Names of the markers.
        kind: What was wrong.
    """

    first: int
    last: int
    labels: tuple[str, ...]
    kind: FaultKind

    def stretch(self, take: MarkerTake) -> DoubtfulStretch:
        """Return the stretch of the take, with a sentence on what was wrong and what was done."""
        start, stop = (int(take.frame_numbers[at]) for at in (self.first, self.last))
        frames = f"frame {start}" if start == stop else f"frames {start} to {stop}"
        markers = " and ".join([", ".join(self.labels[:-1]), self.labels[-1]]) if self.labels[1:] else self.labels[0]
        markers = "left and right" if self.kind is FaultKind.SIDES else markers
        start_s, stop_s = (float(take.times_s[at] - take.times_s[0]) for at in (self.first, self.last))
        reason = f"{markers} {_WHAT[self.kind]} ({frames})"
        return DoubtfulStretch(start_s, stop_s, reason, "", self.first, self.last)


def told(stretches: Sequence[DoubtfulStretch]) -> list[str]:
    """Return sentences on the first faulty stretches, and on how many more there are."""
    more = len(stretches) - _TOLD
    rest = [f"and {more} more stretch{'es' * (more > 1)} with wrong labels"] if more > 0 else []
    return [stretch.reason for stretch in stretches[:_TOLD]] + rest


@dataclass(frozen=True)
class FaultSettings:
    """Settings of `correct_labels`; chosen like `SeamSettings`."""

    fewest_frames: int = 8  # fewest frames from which a marker's typical misses can be estimated
    still_sigmas: float = 0.1  # largest step of a still marker, in standard deviations of its misses
    still_frames: int = 3  # smallest number of equal positions of a still marker
    still_evidence: float = 9.0  # evidence needed that a marker stops or starts as no body does, nats
    still_step: float = 3.0  # cap on the evidence of each step without noise, nats
    rounded: float = 3.0  # smallest noise that rounding does not hide, in units of the rounding
    quietest: float = 0.05  # quantile of a marker's misses that represents its lowest noise
    still_move_m: float = 0.02  # distance that the body must move meanwhile for missing noise to be a fault
    still_harm_m: float = 0.01  # smallest jump at either end that is a fault
    still_drift_m: float = 0.05  # smallest distance, covered at the speed of either end, that is also a fault
    still_drift_evidence: float = 14.0  # evidence needed if only that distance is exceeded, nats
    beside: int = 6  # number of seams on either side that show how sudden the motion is there
    all_still: float = 0.6  # share of other markers, also still, above which the recording had been paused


_S = FaultSettings()


def correct_labels(take: MarkerTake, subject: Subject) -> tuple[MarkerTake, tuple[LabelFault, ...]]:
    """Return a take with faulty labels corrected or removed, and the faults in order of time.

    Args:
        take: Take with the names of the subject's markers; other trajectories are unchanged.
        subject: Performer whose joints carry the markers.
    """
    worn = [marker for marker in subject.marker_set.markers if marker.name in take.names]
    if take.frames < _S.fewest_frames or not worn or np.any(np.diff(take.times_s) <= 0.0):
        return take, ()
    columns, names = [take.names.index(marker.name) for marker in worn], [marker.name for marker in worn]
    joints = [subject.skeleton.index(marker.joint) for marker in worn]
    steps = _steps_between(subject, joints)
    points_m, exchanges = undo_exchanges(take.times_s, take.positions_m[:, columns], steps <= 1)
    last = take.frames - 1
    within = [Exchange(0, last, pair) for pair in exchanged_throughout(points_m, worn, subject.skeleton, steps <= 1)]
    points_m, exchanges = put_back(points_m, within), [*exchanges, *within]
    sides = [Exchange(0, last, pair) for pair in exchanged_sides(points_m, worn, subject.skeleton)]
    points_m, nearest = put_back(points_m, sides), _nearest(steps)
    faults = _exchanged(exchanges, names, FaultKind.EXCHANGED) + _exchanged(sides, names, FaultKind.SIDES)
    scale = SeamScale(take.times_s, points_m)
    for kind in (FaultKind.FROZEN, FaultKind.WILD):
        if kind is FaultKind.FROZEN:
            faulty = _frozen(take.times_s, points_m, scale, nearest)
        else:
            faulty = find_wild_points(take.times_s, points_m, noise_of(subject.marker_set.points), nearest)
        points_m = np.where(faulty[..., None], np.nan, points_m)
        faults += _missing(faulty, names, kind)
    if not faults:
        return take, ()
    positions_m = take.positions_m.copy()
    positions_m[:, columns] = points_m
    single = take.single and _exchanged_views(take.single, [*exchanges, *sides], columns)
    faults.sort(key=lambda each: (each.first, each.last, each.labels))
    return replace(take, positions_m=positions_m, single=single), tuple(faults)


def _steps_between(subject: Subject, joints: Sequence[int]) -> IntArray:
    """Return the number of bones (M, M) between the joints of each two markers."""
    lineages = []
    for joint in joints:
        lineage = [joint]
        while (parent := int(subject.skeleton.parents[lineage[-1]])) >= 0:
            lineage.append(parent)
        lineages.append(frozenset(lineage))
    return np.array([[len(own ^ other) for other in lineages] for own in lineages])


def _nearest(steps: IntArray) -> Mask:
    """Return a mask (M, M) of the other markers that are fewest bones away from each marker."""
    itself = np.eye(len(steps), dtype=bool)
    apart = np.where(itself, steps.max() + 1, steps)
    return np.asarray((apart == apart.min(axis=1, keepdims=True)) & ~itself)


# ---- exchanged labels


def _exchanged(exchanges: Sequence[Exchange], names: Sequence[str], kind: FaultKind) -> list[LabelFault]:
    """Return exchanges as faults; pairs that were exchanged in the same frames become one fault."""
    together: dict[tuple[int, int], list[int]] = {}
    for each in exchanges:
        together.setdefault((each.first, each.last), []).extend(each.markers)
    return [
        LabelFault(first, last, tuple(names[i] for i in sorted(set(markers))), kind)
        for (first, last), markers in together.items()
    ]


def _exchanged_views(single: SingleViews, exchanges: Sequence[Exchange], columns: Sequence[int]) -> SingleViews:
    cameras, points = single.cameras.copy(), single.points.copy()
    for each in exchanges:
        rows, pair = slice(each.first, each.last + 1), [columns[marker] for marker in each.markers]
        cameras[rows, pair] = cameras[rows, pair[::-1]]
        points[rows, pair] = points[rows, pair[::-1]]
    return SingleViews(single.rig, cameras, points)


def _missing(faulty: Mask, names: Sequence[str], kind: FaultKind) -> list[LabelFault]:
    return [
        LabelFault(start, stop - 1, (names[marker],), kind)
        for marker, column in enumerate(faulty.T)
        for start, stop in runs(column)
    ]


# ---- markers that stand still


def _frozen(times_s: Array, points_m: Array, scale: SeamScale, nearest: Mask) -> Mask:
    """Return a mask (F, M) of positions that stay the same although noise or the motion around them contradicts it."""
    steps = np.linalg.norm(np.diff(points_m, axis=0), axis=-1)
    still = steps <= np.maximum(STILL_M, _S.still_sigmas * scale.usual)
    seen = np.isfinite(steps)
    steps_noise = _evidence_of_steps(times_s, points_m, steps)
    frozen = np.zeros(points_m.shape[:2], dtype=bool)
    for marker in range(points_m.shape[1]):
        others = np.arange(points_m.shape[1]) != marker
        for start, stop in runs(still[:, marker]):
            if stop - start + 1 < _S.still_frames:
                continue
            beside = seen[start:stop, others].sum()
            if beside and still[start:stop, others].sum() > _S.all_still * beside:
                continue
            noiseless = steps_noise[marker] * int((steps[start:stop, marker] <= STILL_M).sum())
            filled = noiseless > _S.still_evidence and _moved(points_m, marker, nearest[marker], start, stop)
            if filled or _contradicted(times_s, points_m[:, marker], start, stop, float(scale.usual[marker])):
                frozen[start + 1 : stop + 1, marker] = True
    return frozen


def _evidence_of_steps(times_s: Array, points_m: Array, steps: Array) -> Array:
    """Return the evidence (M,), nats, that each step of length 0 gives that a marker's positions were filled in.

    True positions have noise. Its lowest level is used, if that exceeds the take's rounding.
    """
    moved = steps[np.isfinite(steps) & (steps > STILL_M)]
    rounding_m = max(float(moved.min()), STILL_M) if len(moved) else np.inf
    evidence = np.zeros(points_m.shape[1])
    for marker in range(points_m.shape[1]):
        rows = np.flatnonzero(np.isfinite(points_m[:, marker, 0]))
        if len(rows) < _S.fewest_frames:
            continue
        misses = np.linalg.norm(
            before(times_s[rows], points_m[rows, marker]) - after(times_s[rows], points_m[rows, marker]), axis=1
        )
        misses = misses[misses > STILL_M]
        noise = float(np.quantile(misses, _S.quietest)) / rounding_m if len(misses) else 0.0
        evidence[marker] = min(np.log(noise), _S.still_step) if noise > _S.rounded else 0.0
    return evidence


def _moved(points_m: Array, marker: int, others: Mask, first: int, last: int) -> bool:
    """Return whether a still marker was elsewhere before or is afterwards, or the nearest markers move meanwhile."""
    path, middle, beside = points_m[:, marker], (first + last + 1) // 2, _S.still_frames
    pairs = [
        (path[first + 1 : last + 1], outside)
        for outside in (path[max(first - beside, 0) : first], path[last + 1 : last + 1 + beside])
    ]
    pairs += [(points_m[first:middle, i], points_m[middle : last + 1, i]) for i in np.flatnonzero(others)]
    means = [[part[np.isfinite(part[:, 0])] for part in pair] for pair in pairs]
    return any(
        len(a) > 0 and len(b) > 0 and np.linalg.norm(a.mean(axis=0) - b.mean(axis=0)) > _S.still_move_m
        for a, b in means
    )


def _contradicted(times_s: Array, path: Array, first: int, last: int, sigma_m: float) -> bool:
    """Return whether the motion before or after a still stretch of a path (F, 3) contradicts it.

    Args:
        sigma_m: Typical standard deviation of the marker's misses.
    """
    evidence = jump_m = drift_m = 0.0
    come, go = np.arange(first + 1)[::-1], np.arange(last, len(path))
    for frames, end in ((come, first), (go, last)):
        # a filled gap repeats the last true position, so that belongs to the motion before the gap
        rows = frames[np.isfinite(path[frames, 0])][: 3 + _S.beside][0 if end == first else 1 :]
        if len(rows) < 3:
            continue
        step = 1 if end == first else -1
        other = end + step if end == first else rows[0]
        middle_s = 0.5 * (times_s[end] + times_s[end + 1]) if end == first else 0.5 * (times_s[end] + times_s[other])
        velocity = (path[rows[0]] - path[rows[1]]) / (times_s[rows[0]] - times_s[rows[1]])
        miss = float(np.linalg.norm(path[rows[0]] + (middle_s - times_s[rows[0]]) * velocity - path[end]))
        outside = np.linalg.norm(before(times_s[rows], path[rows]) - after(times_s[rows], path[rows]), axis=1)
        sudden = float(np.nanmedian(outside)) / MEDIAN_LENGTH if np.isfinite(outside).any() else 0.0
        evidence += float(cost(np.array(miss / max(sigma_m, sudden))))
        jump_m = max(jump_m, miss)
        drift_m = max(drift_m, float(np.linalg.norm(velocity)) * (times_s[last] - times_s[first]))
    if jump_m > _S.still_harm_m:
        return evidence > _S.still_evidence
    return drift_m > _S.still_drift_m and evidence > _S.still_drift_evidence
