"""The paper's graph search (section 5.1), extended so that it can leave the last frame's neighbourhood.

The paper only searches the last frame's neighbours and their neighbours in the graph of Eq. 4, so it never notices
similar motion elsewhere in the database. Here the graph is followed from the closest frames for as long as closer ones
are found (in the manner of Malkov and Yashunin 2018). In addition, representatives (one frame of each cluster of poses)
are visited for every frame, and more of them if nothing in the database is very close. For the first frame all
representatives are searched. The cost of a search is bounded.
"""

import numpy as np
from numpy.typing import NDArray

from ...database.k_means import k_means
from ...geometry.arrays import Array, FloatArray, IntArray, Mask
from ..search.exhaustive import ExhaustiveSearch, Query, closest
from .neighbour_graph import NeighbourGraph, weigh_poses

_VISITED = 6.0  # number of frames visited per frame wanted, in addition to the first representatives
_EXPANDED = 0.15  # number of frames expanded at once, as a share of the frames wanted
_STEPS = 3  # number of steps from a representative to its neighbours, and so on
_BEAM, _START_BEAM = 2, 128  # number of frames expanded in each such step, for later frames and for the first
_IDLE = 3  # number of successive expansions without closer frames after which the graph is not followed further
_PROMISING = 2.0  # distance up to which a representative is followed, relative to the median of the frames found last
_SAMPLED = 16  # number of frames of a cluster from which the most central one is chosen to represent it


class GraphSearch:
    """Search among the frames found last, their neighbours, and representatives.

    Args:
        markers_m: Markers (F, M, 3) of the database frames with the root at rest.
        poses: Poses (F, D) of the database frames.
    """

    def __init__(self, markers_m: FloatArray, poses: FloatArray, graph: NeighbourGraph) -> None:
        self._frames = ExhaustiveSearch(markers_m, poses)
        self._neighbours = np.asarray(graph.neighbours)
        self._representatives = _ClusterRepresentatives(poses, np.asarray(graph.clusters))
        self._seen, self._followed = np.zeros((2, len(self._frames)), dtype=np.bool_)
        self.visited = 0

    def nearest(self, query: Query, count: int, start: IntArray | None = None) -> tuple[IntArray, Array]:
        """Return the `count` closest frames found, closest first, and their Eq. 2 distances."""
        visit = _Visit(self._frames, query, self._seen, count)
        groups: list[IntArray] = []
        limit = np.inf
        if start is None:
            representatives, distances = visit.add(self._representatives.frames)
            self._descend(visit, representatives, distances, _START_BEAM)
        else:
            _, distances = visit.add(start)
            limit = _PROMISING * np.partition(distances, len(distances) // 2)[len(distances) // 2]
            leaders = self._frames.distances(query, self._representatives.leaders)
            self.visited += len(leaders)
            order = np.argsort(leaders)
            self._enter(visit, self._representatives.groups[order[0]], limit)
            groups = [self._representatives.groups[group] for group in order[1:] if leaders[group] < limit]
        most = (visit.count if start is None else 0.0) + _VISITED * count
        self._spread(visit, count, groups, limit, most)
        self.visited += visit.count
        return visit.end()

    def near(self, query: Query, count: int, start: IntArray | None = None) -> IntArray:
        """Return the `count` closest frames found, closest first."""
        return self.nearest(query, count, start)[0]

    def nearest_among(self, query: Query, candidates: IntArray) -> tuple[IntArray, Array]:
        """Return the candidate frames and their Eq. 2 distances, sorted by distance."""
        return self._frames.nearest_among(query, candidates)

    def _enter(self, visit: "_Visit", representatives: IntArray, limit: float) -> None:
        """Visit representatives, and descend from those that are near."""
        representatives, distances = visit.add(representatives)
        near = distances < limit
        self._descend(visit, representatives[near], distances[near], _BEAM)

    def _descend(self, visit: "_Visit", frames: IntArray, distances: FloatArray, beam: int) -> None:
        """Visit the neighbours of the closest frames, then the neighbours of the closest of those, and so on."""
        for _ in range(_STEPS):
            if len(frames) == 0:
                return
            chosen, _ = closest(distances, beam)
            frames, distances = visit.add(self._neighbours[frames[chosen]].ravel())

    def _spread(self, visit: "_Visit", count: int, groups: list[IntArray], limit: float, most: float) -> None:
        """Follow the graph from the closest visited frames.

        Args:
            groups: Representatives to visit when the graph leads no closer.
            limit: Distance up to which the graph is followed from representatives.
            most: Largest number of visited frames.
        """
        followed: list[IntArray] = []
        batch = max(1, int(_EXPANDED * count))
        remaining = iter(groups)
        middle, idle = np.inf, 0
        while True:
            found, distances = visit.closest()
            last, middle = middle, float(np.partition(distances, len(distances) // 2)[len(distances) // 2])
            idle = 0 if middle < last else idle + 1
            if visit.count >= most:
                break
            fresh = np.flatnonzero(~self._followed[found])
            if len(fresh) and idle < _IDLE:
                chosen = found[fresh[closest(distances[fresh], batch)[0]]]
                self._followed[chosen] = True
                followed.append(chosen)
                visit.add(self._neighbours[chosen].ravel())
            else:
                group = next(remaining, None)
                if group is None:
                    break
                self._enter(visit, group, limit)
                idle = _IDLE - 1  # one expansion from these, more if they are closer
        for frames in followed:
            self._followed[frames] = False


class _Visit:
    """Frames visited for one query, without duplicates, and the closest of them.

    Args:
        seen: Mask (F,) that is false everywhere; frames visited are set in it until `end` clears it.
        wanted: Number of closest frames to keep.
    """

    def __init__(self, frames: ExhaustiveSearch, query: Query, seen: Mask, wanted: int) -> None:
        self._database, self._query, self._seen, self._wanted = frames, query, seen, wanted
        self._visited: list[IntArray] = []
        self._new: list[FloatArray] = []
        self._found, self._distances = np.empty(0, dtype=np.int64), np.empty(0, dtype=np.float32)
        self.count = 0

    def add(self, frames: IntArray) -> tuple[IntArray, FloatArray]:
        """Return the frames not visited before, without duplicates, and their Eq. 2 distances."""
        frames = frames[frames >= 0]
        unseen = np.unique(frames[~self._seen[frames]]).astype(np.int64)
        distances = self._database.distances(self._query, unseen)
        self._seen[unseen] = True
        self._visited.append(unseen)
        self._new.append(distances)
        self.count += len(unseen)
        return unseen, distances

    def closest(self) -> tuple[IntArray, FloatArray]:
        """Return the closest visited frames and their distances, in any order."""
        if self._new:
            frames = np.concatenate((self._found, *self._visited[-len(self._new) :]))
            distances = np.concatenate((self._distances, *self._new))
            self._new = []
            if len(frames) > self._wanted:
                kept = np.argpartition(distances, self._wanted - 1)[: self._wanted]
                frames, distances = frames[kept], distances[kept]
            self._found, self._distances = frames, distances
        return self._found, self._distances

    def end(self) -> tuple[IntArray, Array]:
        """Clear `seen`; return the closest visited frames, closest first, and their distances."""
        self._seen[np.concatenate(self._visited)] = False
        order, ascending = closest(self._distances, self._wanted)
        return self._found[order], ascending


class _ClusterRepresentatives:
    """Representative frames, one from every cluster of poses, in groups of similar ones.

    Args:
        poses: Poses (F, D) of the database frames.
        clusters: Cluster (F,) of each frame; none is empty.

    Attributes:
        frames: One frame (C,) of each cluster.
        groups: The same frames in about sqrt(C) groups.
        leaders: Most central frame (G,) of each group.
    """

    def __init__(self, poses: FloatArray, clusters: NDArray[np.int32]) -> None:
        order = np.argsort(clusters, kind="stable")
        counts = np.bincount(clusters)
        starts = np.cumsum(counts) - counts
        shares = (np.arange(_SAMPLED) + 0.5) / _SAMPLED
        sampled = order[starts[:, None] + (counts[:, None] * shares).astype(np.int64)]
        away = weigh_poses(poses[sampled])
        away -= away.mean(axis=1, keepdims=True)
        central = np.argmin(np.einsum("csd,csd->cs", away, away), axis=1)
        self.frames: IntArray = sampled[np.arange(len(counts)), central]
        mine = weigh_poses(poses[self.frames])
        centres, group = k_means(mine, round(np.sqrt(len(mine))))
        self.groups = [self.frames[group == index] for index in range(len(centres))]
        away = mine - centres[group]
        apart = np.einsum("cd,cd->c", away, away)
        self.leaders: IntArray = np.array(
            [self.frames[group == index][np.argmin(apart[group == index])] for index in range(len(centres))]
        )
