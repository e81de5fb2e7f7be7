"""Choice of the search by its name and the size of the database."""

import numpy as np

from ...database.graph import NeighbourGraph, build_graph
from ...database.store import Database
from ...geometry.arrays import FloatArray
from .exhaustive import ExhaustiveSearch, Search
from .graph import GraphSearch
from .inverted_file import CellSearch

_EXHAUSTIVE_UP_TO = 150_000  # frames that one exhaustive search looks through in less than half a frame's time


def choose_search(name: str, database: Database, markers_m: FloatArray, poses: FloatArray) -> Search:
    """Return the search of a name.

    Args:
        name: "exhaustive", "cells" (inverted file), "graph" (the paper's), or "auto": exhaustive, which misses
            nothing, in a database below 150,000 frames or stored without its graph; the graph in a larger one.
        database: stored with its graph, or it is built here, which takes half a minute for a million frames.
        markers_m: (F, M, 3) the subject's markers of the database frames with the root at rest.
        poses: (F, D) poses of the database frames.
    """
    if name == "auto":
        name = "exhaustive" if database.graph is None or database.frames < _EXHAUSTIVE_UP_TO else "graph"
    if name == "exhaustive":
        return ExhaustiveSearch(markers_m, poses)
    graph = database.graph or _built(database, poses)
    if name == "cells":
        return CellSearch(markers_m, poses, np.asarray(graph.clusters))
    return GraphSearch(markers_m, poses, graph)


def _built(database: Database, poses: FloatArray) -> NeighbourGraph:
    return build_graph(np.asarray(poses), database.clip_of_frame, database.fps)
