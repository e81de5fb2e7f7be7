"""The benchmark of unknown labels, on a short shipped clip that stands in for a recording."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
from bench import unknown_labels as unknown_labels_bench
from bench.run import Run
from bench.unknown_labels import unknown_labels
from perfanim.core.body.motion import sliced
from perfanim.core.formats.markers.marker_files import write_take
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.simulate.simulated_markers import simulate_markers


@pytest.fixture
def suits(embedded_motion, tmp_path, monkeypatch):
    """Folder with a walk in a suit."""
    walk = sliced(embedded_motion["walking-02-energetic"], 10, 60)
    write_take(simulate_markers(walk, load_marker_set("helen-hayes"), noise_mm=1.0)[0], tmp_path / "walk.trc")
    monkeypatch.setattr("bench.unknown_labels.UNKNOWN_SUITS", {"walk": ("test", "walk.trc")})
    return tmp_path


def test_names_are_counted_against_the_true_ones(suits, embedded_motion, tmp_path, monkeypatch):
    """With a recognition that exchanges two markers, leaves one out, and always finds the same motion."""
    solved = SimpleNamespace(
        report={"marker_set": "helen-hayes"},
        verdict=SimpleNamespace(is_good=False, text="look at it"),
        motion=sliced(embedded_motion["walking-02-energetic"], 10, 60),
        summary=lambda: {"marker_rms_mm": 4.0},
    )
    by_place, wrong = {}, {"L.ASIS": "R.ASIS", "R.ASIS": "L.ASIS", "L.Knee": "L1"}

    def recognised(take, _database):
        places = [tuple(place) for place in take.positions_m[0]]
        if not by_place:  # the first one is under its true names
            by_place.update(zip(places, take.names, strict=True))
            return take, solved
        names = (by_place[place] for place in places)
        return replace(take, names=tuple(wrong.get(name, name) for name in names), notes=("it was looked at",)), solved

    monkeypatch.setattr(unknown_labels_bench, "_solved", recognised)
    monkeypatch.setattr(Run, "each", lambda run, name, work, jobs, rows: [work(*job) for job in jobs.values()])
    rows = unknown_labels(Run(tmp_path, tmp_path / "out", 1), suits=suits, frames=40)["rows"]
    assert [row["labels"] for row in rows] == ["unknown", "exchanged", "arms"]
    counts = [[row[key] for key in ("right", "wrong", "unnamed", "more")] for row in rows]
    assert counts == 3 * [[28, 2, 1, 0]]
    for row in rows:
        assert (row["outcome"], row["by_names"]) == ("told", "look at it")
        assert row["sentence"] == "it was looked at; look at it"
        assert (row["bones_mm"], row["wrists_mm"], row["ratio"]) == (0.0, 0.0, 1.0)


@pytest.mark.long
def test_suits_under_drawn_labels_are_compared_with_their_own_names(suits, tmp_path):
    rows = unknown_labels(Run(tmp_path, tmp_path / "out", 1), suits=suits, frames=40)["rows"]
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
    assert "only markers placed from the motion determine the left arm" in rows[2]["sentence"]
