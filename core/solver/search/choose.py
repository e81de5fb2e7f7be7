"""Choice of the search by its name."""

import numpy as np

from ...database.graph import build_graph
from ...database.store import Database
from ..database_markers import DatabaseMarkers
from .exhaustive import ExhaustiveSearch, Search
from .graph import GraphSearch
from .inverted_file import CellSearch


def choose_search(name: str, database: Database, markers: DatabaseMarkers) -> Search:
    """Return the search of a name.

    Args:
        name: "exhaustive", "graph" (the paper's), "cells" (inverted file) or "auto", the same.
        database: a graph that it does not hold is built here (half a minute for a million frames).
    """
    poses = np.asarray(database.poses).reshape(database.frames, -1)
    if name in ("auto", "cells"):
        return CellSearch(markers, poses)
    if name == "exhaustive":
        return ExhaustiveSearch(markers.all(), poses)
    return GraphSearch(markers.all(), poses, database.graph or build_graph(poses, database.clip_of_frame))
