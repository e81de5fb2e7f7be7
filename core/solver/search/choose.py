"""Choice of the search by its name and the size of the database."""

import numpy as np

from ...database.graph import build_graph
from ...database.store import Database
from ...geometry.arrays import FloatArray
from .bounded import BoundedSearch
from .exhaustive import ExhaustiveSearch, Search
from .graph import GraphSearch
from .inverted_file import CellSearch

_BOUNDED_UP_TO = 150_000  # frames that one search looks through in less than half a frame's time


def choose_search(name: str, database: Database, markers_m: FloatArray, poses: FloatArray) -> Search:
    """Return the search of a name.

    Args:
        name: "exhaustive", "cells" (inverted file), "graph" (the paper's), or "auto": "graph" for a database from
            150,000 frames on that is stored with its graph, else the exhaustive one's result by bounds.
        database: a missing graph is built here (half a minute for a million frames).
        markers_m, poses: as of `ExhaustiveSearch`.
    """
    if name == "auto":
        if database.graph is None or database.frames < _BOUNDED_UP_TO:
            return BoundedSearch(markers_m, poses)
        name = "graph"
    if name == "exhaustive":
        return ExhaustiveSearch(markers_m, poses)
    graph = database.graph or build_graph(np.asarray(poses), database.clip_of_frame)
    if name == "cells":
        return CellSearch(markers_m, poses, np.asarray(graph.clusters))
    return GraphSearch(markers_m, poses, graph)
