"""The neighbour graph of a motion database (Eq. 4), bounded in memory, and the coarse clusters it is built from.

The paper joins every two frames closer than a threshold, so its graph grows with the square of the density. Here every
frame keeps a bounded number of neighbours: the frames before and after it, then the closest ones, one for each time
that a clip comes near before a second of the same pass. They are looked for within coarse clusters of poses and the
clusters beside them, not among all pairs.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..angle_frames import angle_frame
from ..product_skeleton import JOINT_NAMES

FloatArray = NDArray[np.float32]
IntArray = NDArray[np.int32]

JOINT_ANGLES = sum(len(angle_frame(name)[1]) for name in JOINT_NAMES[1:])  # that the L1 distance is averaged over

LARGE_DATABASE = 30_000  # frames from which a graph is worth storing: below, looking at all frames costs little

_ONE_CLUSTER = 2048  # frames up to which all pairs are compared
_MOST_COMPARED = 4096  # frames that a cluster's are compared with; of more, every second or third ... is taken
_CLUSTERS_PER_ROOT = 2.0  # clusters per square root of the number of frames
_SAMPLES_PER_CLUSTER = 24  # frames that a cluster's centre is learned from
_ROUNDS = 4  # of k-means
_BESIDE = 3  # clusters that are searched beside a frame's own
_BLOCK = 1 << 22  # distances held at once
_CHUNK = 8192  # frames


@dataclass(frozen=True)
class GraphSettings:
    """How frames are joined.

    Args:
        largest_step_deg: largest L1 distance of consecutive poses, degrees per joint angle (Delta d of Eq. 4).
        radius_deg: search radius, degrees per joint angle (epsilon of Eq. 4).
        control_fps: rate of the markers that will be solved (f_c of Eq. 4).
        most: neighbours kept per frame, at least 2.
        least: of them, how many are joined however far they are, as the paper's dense databases need not: it keeps
            what moves like nothing else within reach.
    """

    largest_step_deg: float = 1.75
    radius_deg: float = 3.0
    control_fps: float = 60.0
    most: int = 24
    least: int = 12

    def threshold_deg(self, fps: float) -> float:
        """Return the distance of Eq. 4 below which frames of a database of `fps` are joined."""
        return max(fps * self.largest_step_deg / self.control_fps, self.radius_deg)


@dataclass(frozen=True)
class NeighbourGraph:
    """Neighbours and clusters of all frames.

    Args:
        neighbours: (F, N) int32 frame indices, -1 where there are fewer.
        clusters: (F,) int32 cluster of each frame, all from 0 up to the largest in use.
    """

    neighbours: IntArray
    clusters: IntArray


def l1_distance_deg(a: NDArray[Any], b: NDArray[Any]) -> NDArray[Any]:
    """Return the L1 distance of poses (..., D), rotation vectors in radians, in degrees per joint angle."""
    return np.degrees(np.sum(np.abs(a - b), axis=-1)) / JOINT_ANGLES


def build_graph(
    poses: FloatArray, clip_of_frame: NDArray[Any], fps: float, settings: GraphSettings | None = None
) -> NeighbourGraph:
    """Return the neighbour graph of poses (F, D), rotation vectors relative to the joints' means.

    Args:
        poses: (F, D) float32.
        clip_of_frame: (F,) clip index of each frame; frames that follow each other in a clip are always joined.
        fps: rate of the database.
        settings: how frames are joined; default the paper's distances.
    """
    settings = settings or GraphSettings()
    frames = len(poses)
    centres = _centres(poses)
    clusters = _nearest_centres(poses, centres)
    used, clusters = np.unique(clusters, return_inverse=True)
    clusters = clusters.reshape(-1)
    neighbours = np.full((frames, settings.most), -1, dtype=np.int32)
    _join_consecutive(neighbours, clip_of_frame)
    members = np.split(np.argsort(clusters, kind="stable"), np.cumsum(np.bincount(clusters))[:-1])
    for own, beside in enumerate(_clusters_beside(centres[used])):
        columns = np.sort(np.concatenate([members[own]] + [members[cluster] for cluster in beside]))
        stride = max(1, -(-len(columns) // _MOST_COMPARED))
        columns = columns[::stride]
        rows_at_once = max(1, _BLOCK // len(columns))
        for start in range(0, len(members[own]), rows_at_once):
            rows = members[own][start : start + rows_at_once]
            neighbours[rows, 2:] = _closest(poses, rows, columns, stride, settings, settings.threshold_deg(fps))
    return NeighbourGraph(neighbours, clusters.astype(np.int32))


def _centres(poses: FloatArray) -> FloatArray:
    """Return the centres (C, D) of coarse clusters, by k-means on a sample of the frames."""
    if len(poses) <= _ONE_CLUSTER:
        return np.mean(poses, axis=0, keepdims=True)
    count = int(_CLUSTERS_PER_ROOT * np.sqrt(len(poses)))
    random = np.random.default_rng(0)  # the same database every time
    sample = poses[np.sort(random.choice(len(poses), min(len(poses), count * _SAMPLES_PER_CLUSTER), replace=False))]
    centres = sample[random.choice(len(sample), count, replace=False)]
    for _ in range(_ROUNDS):
        nearest = _nearest_centres(sample, centres)
        order = np.argsort(nearest, kind="stable")
        filled, starts = np.unique(nearest[order], return_index=True)
        counts = np.diff(np.append(starts, len(sample)))
        centres[filled] = np.add.reduceat(sample[order], starts, axis=0) / counts[:, None]
    return centres


def _nearest_centres(poses: FloatArray, centres: FloatArray) -> NDArray[np.int64]:
    """Return the index (F,) of the centre closest to each pose."""
    norms = np.einsum("cd,cd->c", centres, centres)
    result = np.empty(len(poses), dtype=np.int64)
    for start in range(0, len(poses), _CHUNK):
        part = slice(start, start + _CHUNK)
        result[part] = np.argmin(norms - 2.0 * (poses[part] @ centres.T), axis=1)
    return result


def _clusters_beside(centres: FloatArray) -> NDArray[np.int64]:
    """Return the indices (C, n) of the clusters closest to each cluster, itself left out."""
    norms = np.einsum("cd,cd->c", centres, centres)
    distances = norms - 2.0 * (centres @ centres.T) + norms[:, None]
    np.fill_diagonal(distances, np.inf)
    return np.argsort(distances, axis=1)[:, : min(_BESIDE, len(centres) - 1)]


def _join_consecutive(neighbours: IntArray, clip_of_frame: NDArray[Any]) -> None:
    """Write each frame's predecessor and successor in its clip into the first two columns."""
    frames = np.arange(len(neighbours), dtype=np.int32)
    joined = np.asarray(clip_of_frame[1:]) == np.asarray(clip_of_frame[:-1])
    neighbours[1:, 0] = np.where(joined, frames[:-1], -1)
    neighbours[:-1, 1] = np.where(joined, frames[1:], -1)


def _closest(
    poses: FloatArray,
    rows: NDArray[np.int64],
    columns: NDArray[np.int64],
    stride: int,
    settings: GraphSettings,
    threshold_deg: float,
) -> IntArray:
    """Return the neighbours (rows, most - 2) among the columns, closest first, -1 where there are fewer.

    Candidates are taken by their L2 distance, of which many are computed at once; Eq. 4 then decides by L1.
    """
    most = settings.most - 2  # beside the frames before and after
    mine, others = poses[rows], poses[columns]
    distances = np.einsum("cd,cd->c", others, others) - 2.0 * (mine @ others.T)
    distances += np.einsum("rd,rd->r", mine, mine)[:, None]
    apart = np.abs(rows[:, None] - columns[None, :])
    distances[apart <= 1] = np.inf  # itself, and those that are joined already
    if len(columns) > most:
        distances[~_closest_of_pass(distances, columns, stride)] += np.float32(1e6)  # only when too few others remain
    kept = min(most, len(columns))
    chosen = np.argpartition(distances, kept - 1, axis=1)[:, :kept]
    chosen = np.take_along_axis(chosen, np.argsort(np.take_along_axis(distances, chosen, 1), axis=1), 1)
    found = columns[chosen]
    unusable = np.isinf(np.take_along_axis(distances, chosen, 1))
    for start in range(0, len(rows), _CHUNK // 8):
        part = slice(start, start + _CHUNK // 8)
        too_far = l1_distance_deg(mine[part, None], poses[found[part]]) >= threshold_deg
        too_far[:, : settings.least] = False
        unusable[part] |= too_far
    result = np.full((len(rows), most), -1, dtype=np.int32)
    result[:, :kept] = np.where(unusable, -1, found)
    return result


def _closest_of_pass(distances: FloatArray, columns: NDArray[np.int64], stride: int) -> NDArray[np.bool_]:
    """Return (rows, columns) whether no frame just before or after in time is closer."""
    follows = np.diff(columns) <= stride
    nearer_than_next = (distances[:, :-1] <= distances[:, 1:]) | ~follows
    result = np.ones(distances.shape, dtype=np.bool_)
    result[:, :-1] &= nearer_than_next
    result[:, 1:] &= (distances[:, 1:] < distances[:, :-1]) | ~follows
    return result
