"""Creation of solving methods and search methods by name."""

import numpy as np

from ..database.store import Database
from .best_method import BestMethod
from .database_markers import DatabaseMarkers
from .method import Method
from .paper.graph_search import GraphSearch
from .paper.methods import LocalPcaMethod, LwrMethod, NearestMethod
from .paper.neighbour_graph import build_graph
from .search.exhaustive import ExhaustiveSearch, Search
from .search.inverted_file import CellSearch
from .settings import SolveSettings
from .subject_model import SubjectModel


def choose_method(
    settings: SolveSettings, subject: SubjectModel, database: Database, markers: DatabaseMarkers
) -> Method:
    """Return the solving method that the settings name."""
    if settings.method == "best":
        return BestMethod(settings.best, settings.query_alpha, subject, database, markers)
    if settings.method == "local-pca":
        return LocalPcaMethod(settings.local_pca, subject, database.clip_of_frame.astype(np.int64))
    if settings.method == "lwr":
        return LwrMethod(settings.lwr, subject)
    return NearestMethod(settings.nearest, subject)


def choose_search(name: str, database: Database, markers: DatabaseMarkers) -> Search:
    """Return the search method that a name stands for.

    Args:
        name: "exhaustive", "graph" (the paper's), "cells" (inverted file) or "auto", which means "cells".
        database: Database to search; a graph for it is built here (half a minute for a million frames).
    """
    poses = np.asarray(database.poses).reshape(database.frames, -1)
    if name in ("auto", "cells"):
        return CellSearch(markers, poses)
    if name == "exhaustive":
        return ExhaustiveSearch(markers.all(), poses)
    return GraphSearch(markers.all(), poses, build_graph(poses, database.clip_of_frame))
