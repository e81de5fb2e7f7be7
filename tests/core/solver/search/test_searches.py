"""The paper's search and the inverted file against looking at every frame."""

from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.database.cells import build_cells
from perfanim.core.database.k_means import clusters_of
from perfanim.core.database.store import Database
from perfanim.core.errors import SettingsError
from perfanim.core.geometry import rotations as rot
from perfanim.core.solver.database_markers import DatabaseMarkers, database_markers
from perfanim.core.solver.method_factory import choose_search
from perfanim.core.solver.observation import Observation
from perfanim.core.solver.paper.graph_search import GraphSearch
from perfanim.core.solver.paper.neighbour_graph import build_graph
from perfanim.core.solver.pose_solver import PoseSolver
from perfanim.core.solver.search.exhaustive import ExhaustiveSearch, Query
from perfanim.core.solver.search.inverted_file import CellSearch
from perfanim.core.solver.settings import SolveSettings

CLIPS, LENGTH, MARKERS, ANGLES = 40, 300, 8, 84
FPS = 60.0
WANTED = 24


class Motions:
    """Cyclic motions of a few parameters; markers are a smooth function of the pose."""

    def __init__(self):
        generator = np.random.default_rng(0)
        self.to_pose = generator.normal(scale=0.15, size=(6, ANGLES))
        self.to_markers = generator.normal(scale=0.015, size=(ANGLES, MARKERS * 3))
        parameters = np.concatenate([self.cycle(generator.uniform(-1, 1, 2), generator) for _ in range(CLIPS)])
        self.poses = (parameters @ self.to_pose).astype(np.float32)
        self.markers = self.markers_of(self.poses).astype(np.float32)
        self.clips = np.repeat(np.arange(CLIPS), LENGTH)

    def cycle(self, style, generator):
        phase = np.arange(LENGTH) * 0.08 * generator.uniform(0.8, 1.2) + generator.uniform(0, 6)
        waves = [np.sin(phase), np.cos(phase), np.sin(2 * phase) * style[0], np.cos(2 * phase) * style[1]]
        return np.stack([*waves, np.full(LENGTH, style[0]), np.full(LENGTH, style[1])], axis=1)

    def markers_of(self, poses):
        return np.sin(poses @ self.to_markers).reshape(-1, MARKERS, 3)

    def queries(self, count=60, hidden=()):
        poses = self.cycle(np.array([0.3, -0.2]), np.random.default_rng(7))[:count] @ self.to_pose
        for number, (pose, markers) in enumerate(zip(poses, self.markers_of(poses), strict=True)):
            seen = markers.copy()
            seen[list(hidden)] = np.nan
            yield Query(seen, pose if number else None, 0.8, 0.002)


@pytest.fixture(scope="module")
def motions():
    return Motions()


@pytest.fixture(scope="module")
def graph(motions):
    return build_graph(motions.poses, motions.clips)


@pytest.fixture(scope="module")
def cells(motions):
    return DatabaseMarkers(clusters_of(motions.poses, 120), motions.markers.__getitem__, 1.0)


class Following:
    """A search that begins each time from the frames found last."""

    def __init__(self, search):
        self._search = search
        self._found = None

    def nearest(self, query, count):
        self._found, distances = self._search.nearest(query, count, self._found)
        return self._found, distances

    def __getattr__(self, name):
        return getattr(self._search, name)


def worst_excess(motions, search, hidden=()):
    """Return by how much the found distances exceed the true ones, relative to the spread among the closest."""
    exhaustive = ExhaustiveSearch(motions.markers, motions.poses)
    excess = []
    for query in motions.queries(hidden=hidden):
        found, true = (s.nearest(query, WANTED)[1] for s in (search, exhaustive))
        excess.append((found.mean() - true.mean()) / (true[-1] - true[0]))
    return max(excess)


def visits(search, query, count=WANTED):
    """Return the frames that a search looks at for a query."""
    before = search.visited
    search.nearest(query, count)
    return search.visited - before


def test_complete_graph_search_is_exhaustive(motions):
    few = slice(0, 400)
    complete = build_graph(motions.poses[few], motions.clips[few], most=402)
    search = Following(GraphSearch(motions.markers[few], motions.poses[few], complete))
    exhaustive = ExhaustiveSearch(motions.markers[few], motions.poses[few])
    for query in motions.queries(30):
        mine, theirs = search.nearest(query, WANTED), exhaustive.nearest(query, WANTED)
        np.testing.assert_allclose(mine[1], theirs[1], atol=1e-5)  # rounding of float32 sums in another order


@pytest.mark.parametrize("hidden", [(), (2,), (0, 5, 7)])
def test_graph_search_finds_nearly_the_closest_frames(motions, graph, hidden):
    search = Following(GraphSearch(motions.markers, motions.poses, graph))
    assert worst_excess(motions, search, hidden) < 0.1
    search = Following(GraphSearch(motions.markers, motions.poses, graph))
    looked_at = [visits(search, query) for query in motions.queries(hidden=hidden)]
    assert np.mean(looked_at[1:]) < 0.03 * len(motions.poses)


def test_visited_counts_computed_distances(motions, graph, monkeypatch):
    computed = []
    distances = ExhaustiveSearch.distances

    def counted(self, query, frames=slice(None)):
        result = distances(self, query, frames)
        computed.append(len(result))
        return result

    monkeypatch.setattr(ExhaustiveSearch, "distances", counted)
    search = Following(GraphSearch(motions.markers, motions.poses, graph))
    for query in motions.queries(5):
        computed.clear()
        assert visits(search, query) == sum(computed) > 0


def test_graph_search_visits_are_bounded(motions, graph):
    search = Following(GraphSearch(motions.markers, motions.poses, graph))
    nowhere = Query(np.full((MARKERS, 3), 3.0), np.full(ANGLES, 5.0), 0.8, 0.002)  # all frames are about as far
    search.nearest(nowhere, WANTED)
    last_looks = 500  # the bound is asked for between looks at some frames' neighbours
    assert visits(search, nowhere) < 6 * WANTED + last_looks


def test_search_follows_jumps_of_the_motion(motions, graph):
    search = Following(GraphSearch(motions.markers, motions.poses, graph))
    for query in motions.queries(30):
        search.nearest(query, WANTED)
    generator = np.random.default_rng(3)
    found = []
    for frame in generator.choice(len(motions.poses), 50, replace=False):
        there = Query(motions.markers[frame].astype(np.float64), motions.poses[frame].astype(np.float64), 0.8, 0.002)
        found.append(search.nearest(there, WANTED)[0][0] == frame)
    assert np.mean(found) > 0.9


@pytest.mark.parametrize("hidden", [(), (2,), (0, 5, 7)])
def test_cell_search_finds_nearly_the_closest_frames(motions, cells, hidden):
    search = CellSearch(cells, motions.poses, scanned=1500)
    assert worst_excess(motions, search, hidden) < 0.1
    looked_at = [visits(search, query) for query in motions.queries(5, hidden=hidden)]
    assert max(looked_at[1:]) < 0.4 * len(motions.poses)  # at first, without a pose, more


def test_search_of_all_cells_is_exhaustive(motions, cells):
    search = CellSearch(cells, motions.poses, scanned=len(motions.poses))
    exhaustive = ExhaustiveSearch(motions.markers, motions.poses)
    for query in motions.queries(5):
        np.testing.assert_allclose(search.nearest(query, WANTED)[1], exhaustive.nearest(query, WANTED)[1], atol=1e-5)


def test_cell_search_finds_the_wanted_count(motions, cells):
    search = CellSearch(cells, motions.poses, scanned=1)
    query = next(iter(motions.queries(1)))
    for count in (1, 500, len(motions.poses), len(motions.poses) + 7):
        assert len(set(search.nearest(query, count)[0])) == min(count, len(motions.poses))


def test_cell_search_visits_do_not_grow_with_the_database(motions):
    looked_at = []
    for frames in (3000, len(motions.poses)):
        groups = clusters_of(motions.poses[:frames], int(np.sqrt(frames)))
        search = CellSearch(DatabaseMarkers(groups, motions.markers.__getitem__, 1.0), motions.poses[:frames], 800)
        looked_at.append([visits(search, query) for query in motions.queries()][1:])
    assert np.mean(looked_at[1]) < 1.3 * np.mean(looked_at[0])


@pytest.mark.parametrize("kind", ["cells", "graph"])
def test_distances_belong_to_the_frames(motions, graph, cells, kind):
    search = (
        CellSearch(cells, motions.poses, 1500)
        if kind == "cells"
        else Following(GraphSearch(motions.markers, motions.poses, graph))
    )
    exhaustive = ExhaustiveSearch(motions.markers, motions.poses)
    for query in motions.queries(10):
        frames, distances = search.nearest(query, WANTED)
        np.testing.assert_allclose(distances, exhaustive.distances(query, frames), atol=1e-5)
        assert np.all(np.diff(distances) >= 0.0)
        assert len(set(frames)) == WANTED
        mine, theirs = (s.nearest_among(query, frames[::-1].copy()) for s in (search, exhaustive))
        np.testing.assert_allclose(mine[1], theirs[1], atol=1e-5)


def test_solver_chooses_by_setting(motions, cells, tmp_path):
    poses = motions.poses.reshape(-1, 28, 3)
    database = Database(tmp_path, FPS, (), (), np.zeros((29, 4)), poses, np.zeros(0), np.zeros(0))
    kinds = {"auto": CellSearch, "exhaustive": ExhaustiveSearch, "cells": CellSearch}
    for name, kind in kinds.items():
        assert type(choose_search(name, database, cells)) is kind
    with pytest.raises(SettingsError, match="search must be one of auto, exhaustive, cells, graph"):
        SolveSettings(search="magic")


@pytest.mark.parametrize("name", ["cells", "graph"])
def test_poses_are_those_of_the_exhaustive_search(database, model, true_markers, truth, name):
    database = replace(database, cells=build_cells(database.poses, database.mean_rotations))
    solvers = [PoseSolver(model, database, SolveSettings(search=search)) for search in ("exhaustive", name)]
    if name == "cells":  # a small database would be looked at as a whole
        poses = database.poses.reshape(database.frames, -1)
        solvers[1]._locator.search = CellSearch(database_markers(model, database), poses, scanned=1200)
    states = [solver.initial_state for solver in solvers]
    apart = []
    for markers in true_markers:
        steps = [s.step(state, Observation.of_points(markers)) for s, state in zip(solvers, states, strict=True)]
        solutions, states = zip(*steps, strict=True)
        local = [model.rotations(solution.pose, solution.root)[1:] for solution in solutions]
        apart.append(np.degrees(rot.angle_between(*local)).mean())
    assert np.mean(apart) < 0.25  # the own error of the method on this clip is ten times that
    assert 0 < solvers[1].visited < len(true_markers) * database.frames
