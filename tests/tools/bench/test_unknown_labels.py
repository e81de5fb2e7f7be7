"""The benchmark of unknown labels, on a short shipped clip that stands in for a recording."""

import pytest
from bench.run import Run
from bench.unknown_labels import unknown_labels
from perfanim.core.body.motion import sliced
from perfanim.core.formats.markers.marker_files import write_take
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.simulate.simulated_markers import simulate_markers


def test_suits_under_drawn_labels_are_compared_with_their_own_names(embedded_motion, tmp_path, monkeypatch):
    walk = sliced(embedded_motion["walking-02-energetic"], 10, 60)
    write_take(simulate_markers(walk, load_marker_set("helen-hayes"), noise_mm=1.0)[0], tmp_path / "walk.trc")
    monkeypatch.setattr("bench.unknown_labels.UNKNOWN_SUITS", {"walk": ("test", "walk.trc")})
    rows = unknown_labels(Run(tmp_path, tmp_path / "out", 1), suits=tmp_path, frames=40)["rows"]
    assert [row["labels"] for row in rows] == ["unknown", "exchanged", "arms"]
    for row in rows[:2]:
        assert (row["set"], row["found"], row["right"]) == ("helen-hayes", "helen-hayes", 31)
        assert (row["wrong"], row["unnamed"], row["more"]) == (0, 0, 0)
        assert row["bones_mm"] == pytest.approx(0.0, abs=0.1) and row["ratio"] == pytest.approx(1.0, abs=0.01)
        assert row["outcome"] == "good" and row["wrists_mm"] < 1.0
    assert "do not match any shipped marker set" in rows[0]["sentence"]
    assert "its labels are wrong" in rows[1]["sentence"]
    assert (rows[2]["outcome"], rows[2]["unnamed"]) == ("told", 4)  # elbows and wrists
    assert rows[2]["wrists_mm"] < 60.0
    assert "only markers placed by the motion hold the left arm" in rows[2]["sentence"]
