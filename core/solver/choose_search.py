"""Which search a solver uses."""

import numpy as np

from ..database.graph import LARGE_DATABASE, NeighbourGraph, build_graph
from ..database.store import Database
from .cell_search import CellSearch
from .graph_search import GraphSearch
from .search import ExhaustiveSearch, FloatArray, Search


def choose_search(name: str, database: Database, markers_m: FloatArray, poses: FloatArray) -> Search:
    """Return the search of a name.

    Args:
        name: "exhaustive", "cells" (inverted file), "graph" (the paper's), or "auto": exhaustive in a database below
            30,000 frames or stored without its graph, the graph in a larger one, which there found the same as the
            exhaustive search more often than the cells at a ninth of their visits.
        database: stored with its graph, or it is built here, which takes a minute for a million frames.
        markers_m: (F, M, 3) the subject's markers of the database frames with the root at rest.
        poses: (F, D) poses of the database frames.
    """
    if name == "auto":
        name = "exhaustive" if database.graph is None or database.frames < LARGE_DATABASE else "graph"
    if name == "exhaustive":
        return ExhaustiveSearch(markers_m, poses)
    graph = database.graph or _built(database, poses)
    cells = CellSearch(markers_m, poses, np.asarray(graph.clusters))
    return cells if name == "cells" else GraphSearch(markers_m, poses, graph.neighbours, cells)


def _built(database: Database, poses: FloatArray) -> NeighbourGraph:
    return build_graph(np.asarray(poses), database.clip_of_frame, database.fps)
