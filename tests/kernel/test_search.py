"""Distances and earlier markers by the kernel are NumPy's, within the rounding of single precision."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from perfanim.core.solver.database_markers import database_markers
from perfanim.core.solver.lagged_history import LaggedFrames, LaggedMarkers, markers_before
from perfanim.core.solver.search.exhaustive import Query
from perfanim.core.solver.search.stored_distances import frame_distances, row_distances
from two_bodies import assert_same, spoiled

EPSILON = float(np.finfo(np.float32).eps)
SPECIAL = st.sampled_from([None, np.nan, np.inf, -np.inf, 1e30, -1e30, 1e-40])


@given(
    seed=st.integers(0, 2**32 - 1),
    count=st.sampled_from([0, 1, 2, 700]),
    width=st.sampled_from([1, 7, 8, 9, 44, 140]),
    special=SPECIAL,
)
def test_any_rows(seed: int, count: int, width: int, special: float | None) -> None:
    generator = np.random.default_rng(seed)
    stored = generator.integers(-32_767, 32_768, size=(50, width), dtype=np.int16)
    target = spoiled(generator.normal(0.0, 20_000.0, size=width).astype(np.float32), special, seed)
    weights = generator.uniform(size=width).astype(np.float32) * (generator.uniform(size=width) < 0.8)
    rows = generator.integers(0, 50, size=count)
    assert_same(row_distances, stored, rows, target, weights.astype(np.float32), rounding=2.0 * width * EPSILON)


@pytest.mark.parametrize("row", [-1, 50, 2**62])
def test_rows_outside_are_refused(row: int) -> None:
    stored, one = np.zeros((50, 9), dtype=np.int16), np.ones(9, dtype=np.float32)
    with pytest.raises(IndexError, match="outside"):
        row_distances.compiled_body(stored, np.array([0, row]), one, one)


@pytest.mark.parametrize("continued", [False, True])
@pytest.mark.parametrize("hidden", [0, 3, 8])
@pytest.mark.parametrize("special", [None, np.nan, np.inf, 1e30])
def test_frames_of_a_database(model, database, true_markers, continued, hidden, special):
    markers, poses = database_markers(model, database), database.poses.reshape(database.frames, -1)
    generator = np.random.default_rng(hidden)
    observed_m = true_markers[3] - true_markers[3].mean(axis=0)
    observed_m[:hidden] = np.nan
    pose = spoiled(poses[7].astype(np.float64), special, 11) if continued else None
    query = Query(observed_m, pose, 0.8, 0.2)
    for count in (0, 1, 300):
        frames = generator.integers(0, database.frames, size=count)
        assert_same(frame_distances, markers, query, poses, frames, rounding=200 * EPSILON)
    with pytest.raises(IndexError, match="outside"):
        frame_distances.compiled_body(markers, query, poses, np.array([database.frames]))


def test_earlier_markers_of_a_database(model, database):
    earlier = LaggedFrames(database, (0.1, 0.25))
    markers = database_markers(model, database)
    lagged = LaggedMarkers(database, markers, earlier)
    frames = np.random.default_rng(0).integers(0, database.frames, size=300)
    for chosen in (frames, frames[:0], frames[::-3]):
        given_ = markers, lagged._root_matrices, lagged._root_positions_m, chosen, earlier.of(chosen)
        assert_same(markers_before, *given_, rounding=50 * EPSILON)
    outside = np.array([[0, database.frames]])
    with pytest.raises(IndexError, match="outside"):
        markers_before.compiled_body(markers, lagged._root_matrices, lagged._root_positions_m, frames[:1], outside)
