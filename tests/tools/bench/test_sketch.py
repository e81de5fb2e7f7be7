"""The benchmark of sketches on shipped motion: its keys, the other methods, and the table."""

import csv
import json

import numpy as np
import pytest
from bench.run import Run
from bench.scenarios import METHODS, Take
from bench.sketch import (
    BEST,
    CONTROLS,
    FRESH,
    IK,
    NEAREST,
    OURS,
    UNSEEN,
    inverse_kinematics,
    sketch,
    sketch_of,
    solved_as_markers,
)
from perfanim.core.body.motion import sliced
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.database.store import open_database
from perfanim.core.formats.motion.bvh import write_bvh
from perfanim.core.geometry import rotations as rot
from perfanim.core.sketch.solve_sketch import key_distances


def positions_of(motion):
    return forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)[0]


def test_keys_are_on_the_true_paths_also_where_they_turn(truth):
    positions, frames = positions_of(truth), np.arange(float(truth.frames))
    even, turns = (sketch_of(truth, ("lfoot",), keys).controls[0] for keys in ("16", "turns"))
    path = positions[:, truth.skeleton.index("lfoot")]
    assert even.frames.tolist() == [0.0, 16.0, 32.0, 48.0, 59.0]
    assert len(turns.frames) == len(even.frames)
    away = [np.linalg.norm(control.curve(frames) - path, axis=1).max() for control in (even, turns)]
    assert away[1] < away[0]
    for control in (even, turns):
        np.testing.assert_array_equal(control.positions_m, path[control.frames.astype(int)])


def test_usual_ik_meets_what_it_can_reach_with_straight_spine_and_bent_knees(truth):
    keys = sketch_of(truth, CONTROLS["five"], "8")
    motion = inverse_kinematics(keys, truth.skeleton)
    distances, _ = key_distances(keys, motion)
    assert np.median(distances) < 1e-3
    positions, index = positions_of(motion), truth.skeleton.index
    spine = np.diff(positions[:, [index("lowerback"), index("thorax")]], axis=1)[:, 0]
    assert (spine[:, 1] > 0.95 * np.linalg.norm(spine, axis=1)).all()
    forwards = rot.rotate(motion.rotations[:, 0], np.array([0.0, 0.0, 1.0]))
    middle = 0.5 * (positions[:, index("lfemur")] + positions[:, index("lfoot")])
    assert (np.sum((positions[:, index("ltibia")] - middle) * forwards, axis=1) > -0.005).all()


def test_methods_for_markers_solve_the_curves(truth, database):
    keys = sketch_of(sliced(truth, 0, 17), CONTROLS["five"], "8")
    nearest, best = (solved_as_markers(keys, truth.skeleton, database, METHODS[name]) for name in ("nearest", "best"))
    assert nearest.frames == best.frames == 17
    assert key_distances(keys, best)[0].max() < key_distances(keys, nearest)[0].max()


def test_takes_are_out_of_the_database_or_end_early(database, tmp_path):
    takes = (Take("walk", "walking-01-neutral"), Take("boxing", "14_02", 0.5))
    clips = {clip.name: clip for clip in Run(tmp_path, tmp_path).without_takes(database, "left", takes).clips}
    assert "walking-01-neutral" not in clips
    assert set(clips) == {clip.name for clip in database.clips} - {"walking-01-neutral"}


@pytest.mark.long
def test_table_compares_all_methods(embedded_motion, tmp_path, monkeypatch):
    folder = tmp_path / "cmu"
    folder.mkdir()
    for trial, name in (
        ("16_16", "walking-02-energetic"),
        ("16_15", "walking-01-neutral"),
        ("09_01", "running-01-brisk"),
    ):
        write_bvh(sliced(embedded_motion[name], 0, 60), folder / f"{trial}.bvh")
    monkeypatch.setattr("bench.sketch.SKETCHED", (Take("walk (16_16)", "16_16"),))
    monkeypatch.setattr("bench.sketch.SKETCHED_FRESH", (Take("walk (16_15)", "16_15"),))
    monkeypatch.setattr("bench.sketch.KEYS", ("16",))
    figures = sketch(Run(tmp_path, tmp_path / "out"))
    methods = [OURS, IK, BEST, NEAREST]
    assert [row["method"] for row in figures["rows"]] == 4 * methods
    assert [row["controls"] for row in figures["rows"]] == [
        each for each in ("five", "three", UNSEEN, FRESH) for _ in methods
    ]
    clips = {
        clip.subject for clip in open_database(tmp_path / "out/databases/cmu-without-sketched-and-16_16.pfdb").clips
    }
    assert clips == {"09"}
    assert 0.0 < figures["edits"][0]["first_picture_ms"] < figures["edits"][0]["from_start_ms"]
    rows = {(row["controls"], row["method"]): row for row in figures["rows"]}
    assert rows["five", OURS]["farthest_key_mm"] < 5.0
    for row in figures["ratios"]:
        ours, usual = (rows[row["controls"], method]["mpjpe_mm"] for method in (OURS, IK))
        assert row[f"of {IK}"] == pytest.approx(ours / usual, abs=1e-3)
    with (tmp_path / "out" / "sketch.csv").open() as stream:
        assert [float(row["mpjpe_mm"]) for row in csv.DictReader(stream)] == [r["mpjpe_mm"] for r in figures["rows"]]
    assert json.loads((tmp_path / "out" / "sketch.json").read_text())["means"] == figures["means"]
