"""The benchmarks that change one condition at a time, on shipped motion that stands in for the recordings."""

import csv
import json

import numpy as np
import pytest
from perfanim.core.body.motion import sliced
from perfanim.core.cli.bench.data import DEVELOPMENT, LEFT_OUT, WALKING, read_take
from perfanim.core.cli.bench.gap import expressible, gap
from perfanim.core.cli.bench.heterogeneity import heterogeneity
from perfanim.core.cli.bench.methods import METHODS, PAPER_RANGE
from perfanim.core.cli.bench.tuning import tuning
from perfanim.core.database.store import open_database
from perfanim.core.formats.motion.bvh import write_bvh

TRIALS = {
    "16_16": "walking-02-energetic",
    "16_31": "walking-04-brisk",
    "35_01": "walking-05-neutral",
    "16_15": "walking-01-neutral",
    "16_17": "walking-03-relaxed",
    "14_02": "boxing-02-tired",
    "14_01": "boxing-01-neutral",
    "09_01": "running-01-brisk",
}
FRAMES = 18


def silent(fraction, text):
    pass


@pytest.fixture(scope="module")
def data(embedded_motion, tmp_path_factory):
    """Folder like that of the recordings, with short shipped clips under the names of the trials, and its index."""
    folder = tmp_path_factory.mktemp("data") / "cmu"
    folder.mkdir()
    rows = ["trial\tdescription"]
    for trial, name in TRIALS.items():
        write_bvh(sliced(embedded_motion[name], 10, 10 + FRAMES), folder / f"{trial}.bvh")
        rows.append(f"{trial}\t{name.split('-')[0].replace('walking', 'walk')}")
    (folder / "index.tsv").write_text("\n".join(rows) + "\n")
    return folder.parent


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    return tmp_path_factory.mktemp("out")


def frames_of(path):
    return {clip.name: clip.stop - clip.start for clip in open_database(path).clips}


def rows_of(path):
    with path.open() as stream:
        return list(csv.DictReader(stream))


def test_heterogeneity_compares_walks_alone_with_everything(data, out, monkeypatch):
    monkeypatch.setattr("perfanim.core.cli.bench.heterogeneity.TAKES", (WALKING,))
    figures = heterogeneity(data, out, 1, silent)
    assert [row["method"] for row in figures["rows"]] == list(METHODS)
    assert set(frames_of(out / "databases/cmu-walking.perfdb")) == {"16_15", "16_17", "16_31"}
    for row in figures["rows"]:
        ratio = row["deg_per_joint (everything)"] / row["deg_per_joint (walking)"]
        assert row["change_percent"] == pytest.approx(100.0 * (ratio - 1.0), abs=0.006)
    assert json.loads((out / "heterogeneity.json").read_text())["rows"] == figures["rows"]
    assert len(rows_of(out / "heterogeneity.csv")) == len(METHODS)


def test_gap_changes_one_condition_at_a_time(data, out, monkeypatch):
    module = "perfanim.core.cli.bench.gap."
    monkeypatch.setattr(module + "_RATES", (30.0,))
    monkeypatch.setattr(module + "_MARKER_SETS", ("locomotion",))
    monkeypatch.setattr(module + "_BOXING_SECONDS", (0.0, 0.2))
    monkeypatch.setattr(module + "_WALKING_SHARES", (0.5,))
    monkeypatch.setattr(module + "_METHODS", ("nearest", "best"))
    monkeypatch.setattr(module + "_MODELS", ((20, 3),))
    monkeypatch.setattr(module + "_SECONDS", 0.2)
    figures = gap(data, out, 1, silent)
    conditions = ["", "0 s", "0.2 s", "30 Hz", "locomotion"]
    assert [row["value"] for row in figures["rows"] if "boxing" in row["take"]] == [c for c in conditions for _ in "ab"]
    assert all(row["deg_per_joint / nearest"] == 1.0 for row in figures["rows"] if row["method"] == "nearest")
    assert "14_02" not in frames_of(out / "databases/cmu-boxing-0s.perfdb")
    assert frames_of(out / "databases/cmu-boxing-0.2s.perfdb")["14_02"] == pytest.approx(0.2 * 60, abs=1)
    walks = [name for name in frames_of(out / "databases/cmu-walking-0.5.perfdb") if name.startswith("16")]
    assert len(walks) < 3
    assert open_database(out / "databases/cmu-without-tests-30.perfdb").fps == 30.0
    assert len(rows_of(out / "gap.csv")) == len(figures["rows"])
    assert len(rows_of(out / "gap-models.csv")) == 4  # two takes, neighbours by markers and by the true pose


def test_the_best_pose_of_a_larger_model_is_closer(database, truth, monkeypatch):
    monkeypatch.setattr("perfanim.core.cli.bench.gap._MODELS", ((40, 3), (40, 20)))
    rows = expressible(sliced(truth, 0, 10), database)
    error = {(row["neighbours by"], row["B"]): row["deg_per_joint"] for row in rows}
    assert error["markers", 20] < error["markers", 3]
    assert error["true pose", 3] <= error["markers", 3]


def test_tuning_sees_no_take_that_is_reported(data, out, monkeypatch):
    takes = tuple(take for take in DEVELOPMENT if take.trial in TRIALS)
    monkeypatch.setattr("perfanim.core.cli.bench.tuning.DEVELOPMENT", takes)
    monkeypatch.setattr("perfanim.core.cli.bench.tuning._SIZES", ((30, 7),))
    monkeypatch.setattr("perfanim.core.cli.bench.tuning._WEIGHTS", {"marker_sigma_m": (0.01,)})
    figures = tuning(data, out, 1, silent)
    held = frames_of(out / "databases/cmu-without-development.perfdb")
    assert not {"16_31", *LEFT_OUT} & set(held)
    assert held["14_02"] == frames_of(out / "databases/cmu.perfdb")["14_02"] // 3
    second = next(take for take in takes if take.trial == "14_02")
    assert read_take(data, second).frames == pytest.approx(held["14_02"], abs=1)
    assert len(figures["rows"]) == len(METHODS) + 3
    for row in figures["rows"]:
        assert row["mean"] == pytest.approx(np.mean([row[take.title] for take in takes]), abs=1e-3)
    paper = next(row for row in rows_of(out / "tuning.csv") if row["varied"] == "local-pca (paper's range)")
    assert paper["K"] == " ".join(map(str, PAPER_RANGE.neighbours))
