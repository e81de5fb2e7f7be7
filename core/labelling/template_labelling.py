"""Labels of points in a calibration pose, by a similarity of a template.

Pairs of points taken for distant template markers give rough placements; the best are refined.
"""

from dataclasses import dataclass

import numpy as np

from ..geometry.arrays import Array, IntArray
from ..geometry.gated_assignment import assign
from ..geometry.rigid_transform import kabsch

_GATE_M = 0.30  # a marker further from where the calibration pose has it is not that marker
_ROUNDS = 8
_SCALES = (0.8, 1.25)  # bodies differ in size from the template
_PAIR_TOLERANCE = 0.3  # relative: pairs of points that may be a given pair of template markers
_PAIRS = 6  # of template markers, the most distant
_HYPOTHESES = 60  # best rough placements that are refined
_TURN_PENALTY_M = 0.02  # per radian away from facing the cameras: decides between near-symmetric placements
_FEWEST_FOUND = 0.6  # share of the markers that must be found to start


def label_by_template(points_m: Array, template_m: Array) -> IntArray:
    """Return labels (N,) of points in a pose like the template's, at any place.

    Args:
        points_m: (N, 3) points in a world with y roughly up; with ghosts, and some markers missing.
        template_m: (M, 3) markers in a calibration pose, facing +z.

    Returns:
        All -1 when too few points fit.
    """
    labels = np.full(len(points_m), -1, dtype=np.int64)
    needed = max(3, int(np.ceil(_FEWEST_FOUND * len(template_m))))
    if len(points_m) < needed:
        return labels
    best_cost = np.inf
    for placement in _rough_placements(points_m, template_m):
        cost, rows, columns = _refine(points_m, template_m, placement)
        if cost < best_cost and len(rows) >= needed:
            best_cost = cost
            labels[:] = -1
            labels[rows] = columns
    return labels


@dataclass(frozen=True)
class _Placement:
    """p_world = scale * turn @ p_template + shift."""

    turn: Array
    shift: Array
    scale: float

    def apply(self, points: Array) -> Array:
        return np.asarray(self.scale * points @ self.turn.T + self.shift)


def _rough_placements(points: Array, template: Array) -> list[_Placement]:
    """Return the best placements from pairs of points for distant template markers."""
    pairs = np.transpose(np.triu_indices(len(template), 1))
    spans = np.linalg.norm(template[pairs[:, 0]] - template[pairs[:, 1]], axis=-1)
    placements, costs = [], []
    for pair in np.argsort(-spans)[:_PAIRS]:
        for i, j in np.ndindex(len(points), len(points)):
            scale = np.linalg.norm(points[i] - points[j]) / spans[pair]
            if i == j or abs(scale - 1.0) > _PAIR_TOLERANCE:
                continue
            placed = _from_pair(template[pairs[pair]], points[[i, j]], float(np.clip(scale, *_SCALES)))
            distances = np.linalg.norm(placed.apply(template)[:, None] - points[None], axis=-1).min(axis=1)
            placements.append(placed)
            costs.append(np.sum(np.minimum(distances, _GATE_M) ** 2))
    return [placements[k] for k in np.argsort(costs)[:_HYPOTHESES]]


def _from_pair(template_pair: Array, point_pair: Array, scale: float) -> _Placement:
    """Return the upright placement of a pair: heading and middle agree."""
    source, target = template_pair[1] - template_pair[0], point_pair[1] - point_pair[0]
    yaw = np.arctan2(target[0], target[2]) - np.arctan2(source[0], source[2])
    cosine, sine = np.cos(yaw), np.sin(yaw)
    turn = np.array([[cosine, 0.0, sine], [0.0, 1.0, 0.0], [-sine, 0.0, cosine]])
    return _Placement(turn, point_pair.mean(axis=0) - scale * turn @ template_pair.mean(axis=0), scale)


def _refine(points: Array, template: Array, placed: _Placement) -> tuple[float, IntArray, IntArray]:
    """Return cost and (points, markers) after alternating assignment and placement."""
    rows = columns = np.empty(0, dtype=np.int64)
    distances = np.empty((len(points), len(template)))
    for _ in range(_ROUNDS):
        distances = np.linalg.norm(points[:, None] - placed.apply(template)[None], axis=-1)
        new_rows, new_columns = assign((distances / _GATE_M) ** 2)
        if len(new_rows) < 3 or (np.array_equal(new_rows, rows) and np.array_equal(new_columns, columns)):
            rows, columns = new_rows, new_columns
            break
        rows, columns = new_rows, new_columns
        placed = _similarity(template[columns], points[rows])
    missed = len(template) - len(rows)
    turned = np.arccos(np.clip(0.5 * (np.trace(placed.turn) - 1.0), -1.0, 1.0))
    cost = np.sum(distances[rows, columns] ** 2) + missed * _GATE_M**2
    return float(cost + (_TURN_PENALTY_M * turned) ** 2 * len(template)), rows, columns


def _similarity(source: Array, target: Array) -> _Placement:
    """Return the least-squares similarity (Umeyama 1991), the scale within bounds."""
    turn, _ = kabsch(source, target)
    p = (source - source.mean(axis=0)) @ turn.T
    scale = float(np.clip(np.sum(p * target) / np.sum(p * p), *_SCALES))
    return _Placement(turn, target.mean(axis=0) - scale * turn @ source.mean(axis=0), scale)
