import numpy as np
import pytest
from perfanim.core.body.clock import ClockFault, clock_of, poses_at, seconds_of
from perfanim.core.errors import TakeError
from perfanim.core.geometry import rotations as rot


def kinds(clock):
    return [note.kind for note in clock.notes]


@pytest.mark.parametrize("fps", [24.0, 25.0, 30000.0 / 1001.0, 60.0, 72.0, 62.5, 100.0, 360.0])
@pytest.mark.parametrize("decimals", [9, 4, 3])
@pytest.mark.parametrize("stated", [True, False])
def test_rounded_times_have_the_rate_that_explains_them(fps, decimals, stated):
    times_s = np.round(5.0 + np.arange(600) / fps, decimals)
    clock = clock_of(times_s, fps if stated else None)
    assert clock.fps == pytest.approx(fps, rel=1e-4)
    assert clock.is_whole and clock.notes == []
    assert np.diff(clock.times_s) == pytest.approx(1.0 / clock.fps)


def test_frame_numbers_count_times_that_are_rounded_to_the_same():
    numbers = np.arange(600)
    clock = clock_of(np.round(numbers / 240.0, 2), 240.0, numbers)
    assert clock.is_whole
    assert clock.times_s == pytest.approx(numbers / 240.0)


def test_lost_frames_are_counted_and_told():
    kept = np.r_[0:25, 55:80]
    clock = clock_of(kept / 60.0, 60.0)
    assert (clock.fps, len(clock.steady_s), clock.lost) == (60.0, 80, 30)
    assert kinds(clock) == [ClockFault.LOST]
    assert clock.sentences[0].startswith("30 of 80 frames are missing, at most 0.52 s in a row")


def test_uneven_frames_have_the_nearest_usual_rate():
    times_s = np.cumsum(np.random.default_rng(0).uniform(0.010, 0.070, 500))
    clock = clock_of(times_s)
    assert clock.fps in (24.0, 25.0) and not clock.is_steady
    assert kinds(clock) == [ClockFault.UNEVEN]
    assert -0.02 <= clock.source_s * clock.fps - (len(clock.steady_s) - 1) < 1.0


@pytest.mark.parametrize("stated", [120.0, 1000.0])
def test_the_times_count_where_a_header_contradicts_them(stated):
    clock = clock_of(np.arange(100) / 50.0, stated)
    assert clock.fps == 50.0
    assert kinds(clock) == [ClockFault.HEADER]
    assert f"{stated:g}" in clock.sentences[0] and "50" in clock.sentences[0]


@pytest.mark.parametrize("stamp_s", [3600.0, -3600.0, np.nan])
def test_a_stamp_that_leaps_is_left_out(stamp_s):
    times_s = np.arange(40) / 60.0
    times_s[20] = stamp_s
    clock = clock_of(times_s)
    assert (clock.fps, len(clock.rows), len(clock.steady_s)) == (60.0, 39, 40)
    assert kinds(clock) == [ClockFault.ORDER, ClockFault.LOST]


def test_a_repeated_frame_does_not_stand_for_a_lost_one():
    clock = clock_of(np.array([0.0, 0.1, 0.2, 0.2, 0.4]), 10.0)
    turns, places_m = np.tile([1.0, 0.0, 0.0, 0.0], (5, 1, 1)), np.array([[0.0], [1.0], [2.0], [2.0], [4.0]])
    assert clock.poses(turns, places_m)[1][:, 0] == pytest.approx([0.0, 1.0, 2.0, 3.0, 4.0])


def test_times_that_do_not_move_have_no_rate():
    for times_s in (np.full(40, np.nan), np.zeros(40), np.zeros(1)):
        with pytest.raises(TakeError, match="too few frames"):
            clock_of(times_s)
    assert clock_of(np.zeros(1), 60.0).is_whole
    with pytest.raises(TakeError, match="too few frames"):
        clock_of(np.zeros(0), 60.0, np.zeros(0, dtype=np.int64))


def test_units_of_times_are_recognised():
    numbers = np.arange(20.0)
    for per_frame in (0.04, 40.0, 40_000.0, 40_000_000.0):
        assert seconds_of(numbers * per_frame) == pytest.approx(numbers * 0.04)
        assert seconds_of(numbers * per_frame, 25.0) == pytest.approx(numbers * 0.04)
    unknown_first = np.concatenate(([np.nan], 40.0 * numbers))
    assert seconds_of(unknown_first)[1:] == pytest.approx(numbers * 0.04)


def test_poses_stay_where_they_are_known_and_are_held_in_long_gaps():
    times_s = np.array([0.0, 0.1, 0.2, 4.2, 4.3])
    turns = rot.from_rotation_vector(np.outer(times_s, [0.0, 1.0, 0.0]))[:, None]
    places = np.outer(times_s, [1.0, 0.0, 0.0])
    wanted_s = np.array([0.0, 0.05, 0.2, 1.0, 3.2, 3.7, 4.2])
    found_turns, found = poses_at(times_s, turns, places, wanted_s)
    assert found[:, 0] == pytest.approx([0.0, 0.05, 0.2, 0.2, 0.2, 2.2, 4.2])
    angles = rot.to_rotation_vector(found_turns)[:, 0, 1]
    assert angles[:5] == pytest.approx([0.0, 0.05, 0.2, 0.2, 0.2], abs=1e-3)


def test_markers_are_missing_beside_gaps_and_in_lost_frames():
    values = np.arange(6.0)[:, None] * np.ones(3)
    visible = np.array([True, True, False, True, True, True])
    uneven = clock_of(np.array([0.0, 0.031, 0.064, 0.09, 0.131, 0.41]))
    found = uneven.seen(values, visible)[:, 0]
    hidden = (uneven.steady_s > 0.032) & (uneven.steady_s < 0.089) | (uneven.steady_s > 0.132)
    assert np.array_equal(np.isnan(found), hidden)
    lost = clock_of(np.array([0, 1, 2, 4, 5, 6]) / 60.0)
    assert np.isnan(lost.seen(values, np.ones(6, dtype=bool))[:, 0]).tolist() == [False] * 3 + [True] + [False] * 3


def test_a_filter_works_at_a_steady_rate_and_gives_the_frames_own_times():
    times_s = np.cumsum(np.random.default_rng(1).uniform(0.010, 0.030, 200))
    line = np.outer(times_s, [1.0, 2.0, 3.0])
    clock = clock_of(times_s)
    seen = []
    same = clock.filtered(line, lambda rows: seen.append(rows) or rows)
    steps = np.diff(seen[0], axis=0) * clock.fps
    assert steps == pytest.approx(np.tile([1.0, 2.0, 3.0], (len(steps), 1)))
    inside = times_s <= clock.steady_s[-1]
    assert same[inside] == pytest.approx(line[inside])
