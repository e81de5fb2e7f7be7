"""The paper's search (section 5.1): among the last frame's neighbours and their neighbours in the graph of Eq. 4."""

import numpy as np
from numpy.typing import NDArray

from .search import Array, ExhaustiveSearch, FloatArray, IntArray, Query, Search, closest

_LOST_M = 0.05  # RMS marker distance of the closest frame beyond which a search is started afresh
_GUIDES = 4  # frames taken from the coarse search
_PATIENCE = 15  # searches between two such starts: what is unlike the database stays so for a while


class GraphSearch:
    """Looks only at the frames found last and at their neighbours.

    What is found can be looked at again with its own neighbours (`rounds`), and only the closest of it with theirs
    (`expanded`): both bound the cost where the database is dense.

    Args:
        markers_m: (F, M, 3) markers of the database frames with the root at rest.
        poses: (F, D) poses of the database frames.
        neighbours: (F, N) frames joined with each frame, -1 where there are fewer.
        start: the search for the first frame, and after a loss; default exhaustive.
        guide: a coarse search whose few closest frames are looked at with the last frame's, so that a motion which
            comes near from elsewhere in the database is noticed; None for the paper's search.
        rounds: how often what has been found is looked at with its neighbours.
        expanded: how many of the closest frames are, in each round.
    """

    def __init__(
        self,
        markers_m: FloatArray,
        poses: FloatArray,
        neighbours: NDArray[np.int32],
        start: Search | None = None,
        guide: Search | None = None,
        rounds: int = 2,
        expanded: int = 1 << 30,
    ) -> None:
        self._frames = ExhaustiveSearch(markers_m, poses)
        self._neighbours = np.asarray(neighbours)
        self._start: Search = start or self._frames
        self._guide = guide
        self._rounds, self._expanded = rounds, expanded
        self._seen = np.zeros(len(self._frames), dtype=np.bool_)
        self.visited = 0
        self.starts = 0
        self.reset()

    def reset(self) -> None:
        """Forget the last frame: the next search starts afresh."""
        self._last: IntArray | None = None
        self._since_start = _PATIENCE

    def nearest(self, query: Query, count: int) -> tuple[IntArray, Array]:
        """Return the `count` closest frames found (ascending) and their Eq. 2 distances."""
        if self._last is None or query.pose is None:
            return self._started(query, count)
        frames, distances = self._followed(query, self._last, count)
        self._since_start += 1
        if self._since_start > _PATIENCE and self._lost(query, frames[0]):
            visited = self.visited
            frames, distances = self._started(query, count)
            self.visited += visited
        self._last = frames
        return frames, distances

    def nearest_among(self, query: Query, candidates: IntArray) -> tuple[IntArray, Array]:
        """Return the candidate frames by their Eq. 2 distances, ascending, and these."""
        return self._frames.nearest_among(query, candidates)

    def _started(self, query: Query, count: int) -> tuple[IntArray, Array]:
        frames, distances = self._start.nearest(query, count)
        self._last, self._since_start = frames, 0
        self.starts += 1
        self.visited = self._start.visited
        return frames, distances

    def _lost(self, query: Query, frame: int) -> bool:
        seen = np.isfinite(query.markers_m[:, 0])
        if not np.any(seen):
            return False
        markers_only = Query(query.markers_m, None, 1.0 / float(seen.sum()), 0.0)
        return bool(self._frames.distances(markers_only, np.array([frame]))[0] > _LOST_M**2)

    def _followed(self, query: Query, last: IntArray, count: int) -> tuple[IntArray, Array]:
        """Return the closest among the last frames and their neighbours, round by round."""
        found, visits = last, 0
        if self._guide is not None:
            found = np.unique(np.concatenate((last, self._guide.nearest(query, _GUIDES)[0])))
            visits = self._guide.visited
        distances = self._frames.distances(query, found)
        self._seen[found] = True
        visited = [found]
        expanded = np.zeros(len(found), dtype=np.bool_)
        for _ in range(self._rounds):
            order, _ = closest(distances, count)
            found, distances, expanded = found[order], distances[order], expanded[order]
            chosen = np.flatnonzero(~expanded)[: self._expanded]
            expanded[chosen] = True
            added = self._unseen(self._neighbours[found[chosen]].ravel())
            if len(added) == 0:
                break
            visited.append(added)
            found = np.concatenate((found, added))
            distances = np.concatenate((distances, self._frames.distances(query, added)))
            expanded = np.concatenate((expanded, np.zeros(len(added), dtype=np.bool_)))
        looked_at = np.concatenate(visited)
        self._seen[looked_at] = False
        self.visited = len(looked_at) + visits
        order, ascending = closest(distances, count)
        return found[order], ascending

    def _unseen(self, frames: NDArray[np.int32]) -> IntArray:
        """Return those frames, each once, that have not been looked at for this query, and mark them."""
        frames = frames[frames >= 0]
        unseen = np.unique(frames[~self._seen[frames]])
        self._seen[unseen] = True
        return unseen.astype(np.int64)
