"""Takes with frames at random times, through every output: how long it lasts, and where the hand is when."""

import json
import struct

import numpy as np
import pytest
from commands import run
from perfanim.core.body.motion import Motion
from perfanim.core.body.motion_metrics import evaluate
from perfanim.core.cli import vmc_command
from perfanim.core.formats.markers.marker_files import read_take, write_take
from perfanim.core.formats.motion.bvh import write_bvh
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.geometry import rotations as rot
from perfanim.core.markers.marker_take import MarkerTake
from perfanim.core.markers.prop import load_prop
from perfanim.core.markers.subject import Subject, save_subject

from tests.helpers.irregular_takes import (
    HAND_MARKER,
    SKELETON,
    SUIT,
    Series,
    hands_at,
    hands_m,
    markers_at,
    poses_at,
    random_series,
    scene_poses,
)
from tests.helpers.solved_poses import write_poses

NEAR_M = 0.005
MOTIONS = ("bvh", "angles.csv", "vrma")
MARKERS = ("c3d", "trc", "csv")
SEEDS = [*range(10), *(pytest.param(seed, marks=pytest.mark.long) for seed in range(10, 50))]


def check_duration(series, frames, fps):
    passed_s = series.true_s[-1] - series.true_s[0]
    assert abs((frames - 1) / fps - passed_s) < 1.0 / fps + 0.001, (frames, fps, passed_s)


def check_hands(series, times_s, hands):
    """Compare positions (F, 3) of the hand, NaN where unknown, with the true ones at times since the first frame."""
    away_m = np.linalg.norm(hands - hands_at(series.true_s[0] + times_s), axis=1)
    assert np.nanmax(away_m) < NEAR_M, np.nanmax(away_m)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """Return a function that writes the recorded take of a series."""
    folder = tmp_path_factory.mktemp("recorded")

    def write(seed, series):
        subject = Subject("waver", SKELETON, SUIT)
        return write_poses(folder, str(seed), [subject], scene_poses(series), [load_prop("sword")])

    return write


@pytest.mark.parametrize("seed", SEEDS)
def test_a_recorded_take_keeps_its_time_in_every_output(seed, recorded, tmp_path, capsys, monkeypatch):
    series = random_series(seed)
    path = recorded(seed, series)
    for ending in (*MOTIONS, *MARKERS):
        told = run(capsys, "take", "export", path, "--out", tmp_path / f"a.{ending}")
        check_duration(series, told["frames"], told["fps"])
    motion = read_motion(tmp_path / "a.bvh")
    check_duration(series, motion.frames, motion.fps)
    check_hands(series, np.arange(motion.frames) / motion.fps, hands_m(motion.rotations, motion.root_positions_m))
    times_s, rotations, roots_m = angles_of(tmp_path / "a.angles.csv")
    check_hands(series, times_s, hands_m(rotations, roots_m))
    assert times_of_vrma(tmp_path / "a.vrma") == pytest.approx(times_s, abs=1e-5)
    for ending in MARKERS:
        check_markers(series, read_take(tmp_path / f"a.{ending}"))
    told = run(capsys, "take", "export", path, "--out", tmp_path / "half.bvh", "--rate", 30)
    check_duration(series, told["frames"], 30.0)
    told = run(capsys, "take", "export", path, "--out", tmp_path / "sword.csv", "--prop", "sword")
    check_duration(series, told["frames"], told["fps"])
    rows = table_of(tmp_path / "sword.csv")
    check_hands(series, rows[:, 1] - rows[0, 1], rows[:, 2:5])
    sent = []
    monkeypatch.setattr(vmc_command, "play", lambda motion, *_: sent.append(motion) or 0)
    told = run(capsys, "vmc", "send", path, "--rate", 60)
    check_duration(series, told["frames"], 60.0)
    assert told["duration_s"] == sent[0].duration_s
    told = run(capsys, "take", "info", path)
    passed_s = series.true_s[-1] - series.true_s[0]
    assert told["duration_s"] == pytest.approx(passed_s, abs=0.0011)
    assert told["mean_fps"] == pytest.approx((len(series.true_s) - 1) / passed_s, rel=0.002)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_marker_file_keeps_its_time_in_every_format(seed, tmp_path, capsys):
    series = random_series(seed)
    write_table(series, tmp_path / "in.csv")
    for ending in MARKERS:
        told = run(capsys, "take", "export", tmp_path / "in.csv", "--out", tmp_path / f"a.{ending}")
        check_duration(series, told["frames"], told["fps"])
        check_markers(series, read_take(tmp_path / f"a.{ending}"))


TIMES = {
    "webcams": random_series(1),
    "360 Hz to 1 ms": Series(np.arange(60) / 360.0, np.round(np.arange(60) / 360.0, 3), 360.0),
    "60 Hz to 0.1 ms": Series(np.arange(60) / 60.0, np.round(np.arange(60) / 60.0, 4), 60.0),
}


@pytest.mark.parametrize("kind", TIMES)
def test_an_imported_take_is_told_exported_and_solved_in_its_time(kind, tmp_path, capsys, database_file):
    series = TIMES[kind]
    write_table(series, tmp_path / "in.csv")
    save_subject(Subject("waver", SKELETON, SUIT), tmp_path / "waver.toml")
    body = ("--subject", tmp_path / "waver.toml", "--database", database_file, "--method", "nearest")
    run(capsys, "take", "import", tmp_path / "in.csv", *body, "--out", tmp_path)
    told = run(capsys, "take", "info", tmp_path / "in.perftake")
    assert kind == "webcams" or told["fps"] == series.stated_fps
    for line in (("take", "export"), ("solve",)):
        facts = run(capsys, *line, tmp_path / "in.perftake", "--out", tmp_path / "a.bvh")
        motion = read_motion(tmp_path / "a.bvh")
        assert facts["fps"] == told["fps"] == pytest.approx(motion.fps, rel=1e-4)
        check_duration(series, motion.frames, told["fps"])


@pytest.mark.long
@pytest.mark.long
def test_a_batch_reports_and_writes_the_true_durations(tmp_path, capsys, database_file):
    seeds = {f"take{seed:02}": seed for seed in range(0, 50, 10)} | {"take07": 7}
    (tmp_path / "takes").mkdir()
    write_bvh(Motion("waver", 30.0, SKELETON, *poses_at(np.zeros(2))), tmp_path / "waver.bvh")
    for name, seed in seeds.items():
        write_table(random_series(seed), tmp_path / "takes" / f"{name}.csv")
    body = ("--skeleton", tmp_path / "waver.bvh", "--marker-set", "boxing", "--database", database_file)
    told = run(
        capsys, "batch", tmp_path / "takes", *body, "--method", "nearest", "--jobs", 1, "--out", tmp_path / "out"
    )
    assert {row["name"] for row in told["takes"]} == seeds.keys()
    for row in told["takes"]:
        series, motion = random_series(seeds[row["name"]]), read_motion(tmp_path / "out" / f"{row['name']}.bvh")
        check_duration(series, motion.frames, motion.fps)
        assert row["figures"]["duration_s"] == pytest.approx(motion.duration_s, abs=0.001)


def check_markers(series, take):
    """A marker file states a rate that agrees with its times, lasts as long, and has the hand where it was."""
    assert np.diff(take.times_s) == pytest.approx(1.0 / take.fps, abs=2e-6)
    check_duration(series, take.frames, take.fps)
    check_hands_of_markers(series, take)


def check_hands_of_markers(series, take):
    true_m = markers_at(series.true_s[0] + take.times_s - take.times_s[0])[:, HAND_MARKER]
    away_m = np.linalg.norm(take.positions_m[:, HAND_MARKER] - true_m, axis=1)
    assert np.isfinite(away_m).mean() > 0.5
    assert np.nanmax(away_m) < NEAR_M


def write_table(series, path):
    """Write the markers of a series as other programs do: the header's rate, and the times as they came."""
    take = MarkerTake("in", 60.0, SUIT.names, markers_at(series.true_s))
    write_take(take, path)
    lines = path.read_text().splitlines()
    rows = [line.split(",", 2) for line in lines[2:]]
    rows = [f"{row[0]},{time_s!r},{row[2]}" for row, time_s in zip(rows, series.written_s.tolist(), strict=True)]
    path.write_text("\n".join([f"# fps={series.stated_fps!r}", lines[1], *rows]) + "\n")


def table_of(path):
    """Return the numbers of a CSV file below its header, NaN for blank ones."""
    lines = [line for line in path.read_text().splitlines() if not line.startswith("#")]
    return np.genfromtxt(lines[1:], delimiter=",")


def angles_of(path):
    """Return times (F,), rotations (F, J, 4) and root positions (F, 3) of a table of joint angles."""
    rows = table_of(path)
    angles = np.radians(rows[:, 5:]).reshape(len(rows), -1, 3)
    return rows[:, 1], rot.from_euler(angles, "ZXY"), rows[:, 2:5]


def times_of_vrma(path):
    """Return the key times (F,) of a VRM animation."""
    data = path.read_bytes()
    length = struct.unpack_from("<I", data, 12)[0]
    document, start = json.loads(data[20 : 20 + length]), 28 + length
    accessor = document["accessors"][document["animations"][0]["samplers"][0]["input"]]
    view = document["bufferViews"][accessor["bufferView"]]
    return np.frombuffer(data, "<f4", accessor["count"], start + view["byteOffset"])


def test_a_motion_is_compared_with_its_truth_by_time(recorded, tmp_path, capsys):
    series = random_series(1)
    run(capsys, "take", "export", recorded("compared", series), "--out", tmp_path / "a.bvh")
    times_s = series.true_s[0] + np.arange(0.0, series.true_s[-1] - series.true_s[0], 0.01)
    motion = read_motion(tmp_path / "a.bvh")
    truth = motion.__class__("truth", 100.0, SKELETON, *poses_at(times_s))
    assert evaluate(motion, truth)["mpjpe_absolute_mm"] < 2.0
