"""Calibration of a prop from a take: the markers that form a rigid body are found and measured."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ..errors import PropError, counted
from ..geometry.arrays import Array, Mask
from ..geometry.point_patterns import planarity_m
from ..geometry.rigid_transform import kabsch, principal_axes, transform
from ..markers.marker_take import MarkerTake
from ..markers.prop import FEWEST_MARKERS, MOST_MARKERS, Prop


@dataclass(frozen=True)
class PropSettings:
    """Settings of the calibration."""

    rigid_m: float = 0.003  # largest median deviation of the distance between two of a prop's markers
    fewest_frames: int = 10  # fewest frames in which both markers must be visible
    rounds: int = 5
    poor_m: float = 0.002  # RMS residual above which a prop bends or is poorly seen


SETTINGS = PropSettings()


@dataclass(frozen=True)
class PropCalibration:
    """A calibrated prop.

    Args:
        prop: Prop with its markers in its own frame: the origin at their centre, y along their greatest extent towards
            the end where they are sparser, x along the next greatest.
        frames: Number of frames used.
        left_out: Markers of the take that do not belong to the prop.
    """

    prop: Prop
    frames: int
    left_out: tuple[str, ...]
    advice: tuple[str, ...]


def calibrate_prop(take: MarkerTake, name: str, markers: Sequence[str] = ()) -> PropCalibration:
    """Return the prop formed by the markers whose distances from each other hardly change.

    Args:
        take: Take of the prop, lying or moved; other markers are left out unless they move with it.
        markers: Names of the prop's markers; empty for the largest rigid group.

    Raises:
        PropError: There are fewer than three such markers, or they cannot be distinguished (see `Prop`).
    """
    unknown = [marker for marker in markers if marker not in take.names]
    if unknown:
        known = "choose from its markers: " + ", ".join(take.names)
        raise PropError("has no marker " + ", ".join(unknown), where=take.name, advice=known)
    chosen = [take.names.index(marker) for marker in markers] or _largest_group(take)
    if len(chosen) < FEWEST_MARKERS:
        raise PropError(
            f"{counted(len(chosen), 'marker')} cannot define a pose",
            where=take.name,
            advice=f"name {FEWEST_MARKERS} or more markers",
        )
    if len(chosen) > MOST_MARKERS:
        raise PropError(
            f"{len(chosen)} markers form one rigid group, but a prop has at most {MOST_MARKERS}",
            where=take.name,
            advice="choose frames in which the prop is moved, or name its markers",
        )
    shape, residual_m, frames = _mean_shape(take.positions_m[:, chosen], take.name)
    names = tuple(take.names[index] for index in chosen)
    prop = Prop(name, names, _upright(shape), residual_m)
    left_out = tuple(other for other in take.names if other not in names)
    advice = []
    if len(chosen) == FEWEST_MARKERS:
        advice.append("with a fourth marker the prop would be found at once, even with one marker hidden")
    if residual_m > SETTINGS.poor_m:
        moved = f"{1e3 * residual_m:.1f} mm"
        advice.append(f"its markers move by {moved} relative to each other: fasten them, and move the prop slowly")
    return PropCalibration(prop, frames, left_out, tuple(advice))


def _largest_group(take: MarkerTake) -> list[int]:
    """Return the markers of the largest rigid group."""
    count = len(take.names)
    rigid = np.zeros((count, count), dtype=bool)
    for first, second in combinations(range(count), 2):
        spans = np.linalg.norm(take.positions_m[:, first] - take.positions_m[:, second], axis=1)
        spans = spans[np.isfinite(spans)]
        if len(spans) >= min(SETTINGS.fewest_frames, take.frames):
            deviation = float(np.median(np.abs(spans - np.median(spans))))
            rigid[first, second] = rigid[second, first] = deviation < SETTINGS.rigid_m
    groups = sorted(_groups(rigid), key=len)
    if not groups or len(groups[-1]) < FEWEST_MARKERS:
        raise PropError(
            f"no {FEWEST_MARKERS} of its {count} markers form a rigid group",
            where=take.name,
            advice="record the prop alone, lying in front of the cameras, or moving slowly",
        )
    if len(groups) > 1 and len(groups[-2]) == len(groups[-1]):
        choices = " or ".join(", ".join(take.names[index] for index in sorted(group)) for group in groups[-2:])
        raise PropError(f"the prop's markers may be {choices}", where=take.name, advice="name those of the prop")
    return sorted(groups[-1])


def _groups(joined: Mask) -> list[set[int]]:
    """Return all maximal cliques of a graph, given as a mask (N, N), by the algorithm of Bron and Kerbosch."""
    found: list[set[int]] = []

    def grow(group: set[int], candidates: set[int], excluded: set[int]) -> None:
        if not candidates and not excluded:
            found.append(group)
            return
        pivot = max(candidates | excluded, key=lambda node: int(joined[node, list(candidates)].sum()))
        for node in [node for node in candidates if not joined[pivot, node]]:
            near = set(np.flatnonzero(joined[node]).tolist())
            grow(group | {node}, candidates & near, excluded & near)
            candidates = candidates - {node}
            excluded = excluded | {node}

    grow(set(), set(range(len(joined))), set())
    return found


def _mean_shape(positions_m: Array, where: str) -> tuple[Array, float, int]:
    """Return the shape (M, 3) that fits all frames (F, M, 3) best, its residual, and the number of frames used.

    The shape is alternately fitted to each frame and replaced by the mean of the frames. Frames that fit badly because
    markers were confused are left out.
    """
    seen = np.all(np.isfinite(positions_m), axis=2)
    usable = [f for f in np.flatnonzero(seen.sum(axis=1) >= FEWEST_MARKERS) if planarity_m(positions_m[f][seen[f]]) > 0]
    whole = [f for f in usable if seen[f].all()]
    if not whole:
        raise PropError(
            f"the {positions_m.shape[1]} markers of the prop are never all seen at once",
            where=where,
            advice="turn the prop more slowly",
        )
    shape = positions_m[whole[len(whole) // 2]]
    residual_m = 0.0
    for _ in range(SETTINGS.rounds):
        brought = np.full((len(usable), *shape.shape), np.nan)
        for row, f in enumerate(usable):
            turn, shift = kabsch(shape[seen[f]], positions_m[f][seen[f]])
            brought[row] = transform(turn.T, -turn.T @ shift, positions_m[f])
        off = np.sqrt(np.nanmean(np.sum((brought - shape) ** 2, axis=2), axis=1))
        good = off <= max(3.0 * float(np.median(off)), 1e-6)
        shape = np.nanmean(brought[good], axis=0)
        residual_m = float(np.sqrt(np.nanmean(np.sum((brought[good] - shape) ** 2, axis=2))))
    return shape, residual_m, int(good.sum())


def _upright(shape_m: Array) -> Array:
    """Return the markers (M, 3) of a shape in the prop's own frame (see `PropCalibration`)."""
    middle, _, axes = principal_axes(shape_m)
    centred = shape_m - middle
    along, across = (axis * (1.0 if np.sum((centred @ axis) ** 3) >= 0.0 else -1.0) for axis in axes[:2])
    return np.asarray(centred @ np.stack((across, along, np.cross(across, along)), axis=1))
