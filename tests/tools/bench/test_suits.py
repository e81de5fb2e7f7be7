"""The benchmark of suits, on a short shipped clip that stands in for a recording."""

from pathlib import Path

import pytest
from bench.run import Run
from bench.scenarios import Take
from bench.suits import suits
from perfanim.core.body.motion import sliced
from perfanim.core.errors import FormatError
from perfanim.core.formats.markers.marker_files import write_take
from perfanim.core.formats.motion.bvh import write_bvh
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.simulate.simulated_markers import simulate_markers


@pytest.fixture
def data(embedded_motion, tmp_path):
    """Folder with two clips as CMU's and a walk in a suit."""
    folder = tmp_path / "data"
    (folder / "cmu").mkdir(parents=True)
    for trial, name in (("16_15", "walking-01-neutral"), ("35_01", "walking-03-relaxed")):
        write_bvh(sliced(embedded_motion[name], 0, 40), folder / "cmu" / f"{trial}.bvh")
    walk = sliced(embedded_motion["walking-02-energetic"], 10, 40)
    write_take(simulate_markers(walk, load_marker_set("plug-in-gait"))[0], folder / "walk.trc")
    return folder


@pytest.mark.long
def test_a_suit_is_solved_with_nine_markers(data, tmp_path, monkeypatch):
    monkeypatch.setattr("bench.suits.SUITS", {"walk": "walk.trc"})
    monkeypatch.setattr("bench.suits.keypoints", lambda run: ([], {}))
    figures = suits(Run(data, tmp_path, 1))
    rows = {row["method"]: row for row in figures["rows"]}
    assert set(rows) == {"live", "offline"}
    assert {len(row["used"].split()) for row in rows.values()} == {9}
    assert all(1.0 < row["left_out_rms_mm"] < 150.0 for row in rows.values())
    assert figures["missing"] == [] == figures["ratios"]
    assert [(row["take"], row["way"], row["frames"]) for row in figures["intervals"]] == [
        (take, way, 30) for take in ("walk", "all") for way in ("live", "offline")
    ]
    for row in figures["intervals"]:
        assert row["by_part"]["left leg"] > 0.5  # the pose of nine markers is near that of all


@pytest.mark.long
def test_suits_are_solved_with_the_same_nine_markers_by_both_versions(data, tmp_path, monkeypatch):
    monkeypatch.setattr("bench.suits.SUITS", {"walk": "walk.trc", "run": "run.trc"})
    monkeypatch.setattr("bench.keypoints.KEYPOINT_TAKES", ((Take("walk", "16_15"), "halpe-26"),))
    figures = suits(Run(data, tmp_path, 1), Path(__file__).parents[3])
    rows = {row["method"]: row for row in figures["rows"]}
    assert set(rows) == {"live", "offline", "offline of the other version"}
    assert {len(row["used"].split()) for row in rows.values()} == {9}
    assert all(1.0 < row["left_out_rms_mm"] < 150.0 for row in rows.values())
    assert figures["missing"] == ["run"]
    by_way = {row["method"]: row for row in figures["ratios"]}
    # this checkout stands in for the other version: offline is as it is
    assert by_way["offline"]["left_out"] == pytest.approx(1.0, abs=0.05)
    assert by_way["live"]["worst"] == by_way["live"]["left_out"]
    keypoints = {row["way"]: row for row in figures["keypoints"]}
    assert keypoints["offline"]["jitter_of_points"] < 0.1 and keypoints["offline"]["mpjpe_mm"] < 100.0
    assert keypoints["offline"]["tilt_deg"] < 15.0 and abs(keypoints["offline"]["feet_above_mm"]) < 60.0
    assert figures["outputs"][-1].endswith("keypoint-strips.png")


def test_a_folder_without_suits_is_told(tmp_path):
    with pytest.raises(FormatError, match=r"holds none of the suits' takes.*--suits"):
        suits(Run(tmp_path, tmp_path / "out"))
