"""Labelling points of a body in a calibration pose, by a similarity transform of a template.

Pairs of points assigned to distant template markers give rough placements; the best of these are refined.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..geometry.arrays import Array, IntArray
from ..geometry.gated_assignment import assign
from ..geometry.point_patterns import point_distances
from ..geometry.rigid_transform import kabsch


@dataclass(frozen=True)
class TemplateSettings:
    """Settings of `label_by_template`, tuned on calibration poses of people of many sizes."""

    gate_m: float = 0.30  # largest distance of a point from its template marker
    scales: tuple[float, float] = (0.8, 1.25)  # size of bodies relative to the template
    pair_tolerance: float = 0.3  # largest relative difference between two points' distance and that of their markers
    pairs: int = 6  # number of pairs of template markers tried, the most distant ones
    refined: int = 60  # number of rough placements that are refined
    rounds: int = 8  # largest number of assignments in one refinement
    turn_penalty_m: float = 0.02  # cost per radian of turn from the cameras; decides between almost symmetric poses
    fewest_found: float = 0.6  # share of the markers that must be found


_S = TemplateSettings()


class Similarity(NamedTuple):
    """p_world = scale * turn @ p_template + shift."""

    turn: Array
    shift: Array
    scale: float

    def apply(self, points: Array) -> Array:
        """Return the points (N, 3) in the world."""
        return np.asarray(self.scale * points @ self.turn.T + self.shift)


def similarity(source: Array, target: Array, scales: tuple[float, float] = (0.0, np.inf)) -> Similarity:
    """Return the least-squares similarity transform (Umeyama 1991) with its scale within bounds."""
    turn, _ = kabsch(source, target)
    turned = (source - source.mean(axis=0)) @ turn.T
    scale = float(np.clip(np.sum(turned * target) / np.sum(turned * turned), *scales))
    return Similarity(turn, target.mean(axis=0) - scale * turn @ source.mean(axis=0), scale)


def label_by_template(points_m: Array, template_m: Array) -> IntArray:
    """Return labels (N,) of points in a pose like the template's; all are -1 if too few fit.

    Args:
        points_m: Points (N, 3) in a world with y roughly up, with ghosts and hidden markers.
        template_m: Markers (M, 3) in a calibration pose, facing +z.
    """
    labels = np.full(len(points_m), -1, dtype=np.int64)
    needed = max(3, int(np.ceil(_S.fewest_found * len(template_m))))
    if len(points_m) < needed:
        return labels
    best_cost, refined = np.inf, set()
    for placement in _rough_placements(points_m, template_m):
        first = _assigned(points_m, template_m, placement)[1:]
        key = b"".join(each.tobytes() for each in first)
        if len(first[0]) < 3 or key in refined:  # the same assignment would lead to the same result
            continue
        refined.add(key)
        cost, rows, columns = _refine(points_m, template_m, *first)
        if cost < best_cost and len(rows) >= needed:
            best_cost = cost
            labels[:] = -1
            labels[rows] = columns
    return labels


def _rough_placements(points: Array, template: Array) -> list[Similarity]:
    """Return the best placements, from pairs of points assigned to distant template markers."""
    pairs = np.transpose(np.triu_indices(len(template), 1))
    spans = np.linalg.norm(template[pairs[:, 0]] - template[pairs[:, 1]], axis=-1)
    apart = point_distances(points, points)
    placements = []
    for pair in np.argsort(-spans)[: _S.pairs]:
        scales = apart / spans[pair]
        for i, j in np.argwhere(np.abs(scales - 1.0) <= _S.pair_tolerance):
            scale = float(np.clip(scales[i, j], *_S.scales))
            placements.append(_from_pair(template[pairs[pair]], points[[i, j]], scale))
    if not placements:
        return []
    placed = np.concatenate([placement.apply(template) for placement in placements])
    nearest = point_distances(placed, points).min(axis=1).reshape(len(placements), -1)
    costs = np.sum(np.minimum(nearest, _S.gate_m) ** 2, axis=1)
    return [placements[k] for k in np.argsort(costs)[: _S.refined]]


def _from_pair(template_pair: Array, point_pair: Array, scale: float) -> Similarity:
    """Return the upright placement in which a template pair has the heading and the centre of a pair of points."""
    source, target = template_pair[1] - template_pair[0], point_pair[1] - point_pair[0]
    yaw = np.arctan2(target[0], target[2]) - np.arctan2(source[0], source[2])
    cosine, sine = np.cos(yaw), np.sin(yaw)
    turn = np.array([[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]])
    return Similarity(turn, point_pair.mean(axis=0) - scale * turn @ template_pair.mean(axis=0), scale)


def _assigned(points: Array, template: Array, placed: Similarity) -> tuple[Array, IntArray, IntArray]:
    """Return the distances (N, M) of points from a placed template's markers, and the assignment (points, markers)."""
    distances = point_distances(points, placed.apply(template))
    return distances, *assign((distances / _S.gate_m) ** 2)


def _refine(points: Array, template: Array, rows: IntArray, columns: IntArray) -> tuple[float, IntArray, IntArray]:
    """Return cost and assignment (points, markers) after alternating placement and assignment from a first one."""
    placed = similarity(template[columns], points[rows], _S.scales)
    for _ in range(1, _S.rounds):
        before = rows, columns
        distances, rows, columns = _assigned(points, template, placed)
        if len(rows) < 3 or (np.array_equal(rows, before[0]) and np.array_equal(columns, before[1])):
            break
        placed = similarity(template[columns], points[rows], _S.scales)
    missed = len(template) - len(rows)
    turned = np.arccos(np.clip(0.5 * (np.trace(placed.turn) - 1.0), -1.0, 1.0))
    cost = np.sum(distances[rows, columns] ** 2) + missed * _S.gate_m**2
    return float(cost + (_S.turn_penalty_m * turned) ** 2 * len(template)), rows, columns
