"""The trials and measures of published work, on shipped clips that stand in for recordings."""

from dataclasses import replace

import numpy as np
import pytest
from bench.published import published, published_measures
from bench.run import Run
from bench.scenarios import Take
from perfanim.core.body.motion import sliced
from perfanim.core.formats.motion.bvh import write_bvh
from perfanim.core.geometry import rotations as rot


def test_published_measures_of_a_known_error(truth):
    still, turned, head = truth.rotations.copy(), truth.rotations.copy(), truth.skeleton.index("head")
    for above in ("upperneck", "head"):
        still[:, truth.skeleton.index(above)] = turned[:, truth.skeleton.index(above)] = rot.identity()
    truth = replace(truth, rotations=still)
    turned[:, head] = rot.from_rotation_vector([0.0, 0.0, np.radians(6.3)])
    shifted = replace(truth, rotations=turned, root_positions_m=np.add(truth.root_positions_m, [0.003, 0.0, 0.004]))
    measures = published_measures(shifted, truth)
    assert measures["mpjpe_world_mm"] == pytest.approx(5.0)  # the head's turn moves no joint
    assert measures["mpjve_cm_s"] == pytest.approx(0.0, abs=1e-9)
    assert measures["mpjre_deg"] == pytest.approx(0.1)  # one of 63 components
    assert measures["jitter_100_m_s3"] == pytest.approx(measures["jitter_truth_100_m_s3"])


def test_trials_are_solved_without_themselves_in_the_database(embedded_motion, tmp_path, monkeypatch):
    folder = tmp_path / "cmu"
    folder.mkdir()
    for trial, name in (("16_15", "walking-01-neutral"), ("16_17", "walking-03-relaxed")):
        write_bvh(sliced(embedded_motion[name], 0, 60), folder / f"{trial}.bvh")
    monkeypatch.setattr("bench.published.PUBLISHED_TAKES", (Take("walk (16_15)", "16_15"),))
    figures = published(Run(tmp_path, tmp_path / "out", 1))
    assert figures["database"]["clips"] == 1
    assert [(row["take"], row["way"]) for row in figures["rows"]] == [
        ("walk (16_15)", "live"),
        ("walk (16_15)", "offline"),
    ]
    assert {row["way"]: row["mpjpe_world_mm"] for row in figures["means"]} == {
        row["way"]: row["mpjpe_world_mm"] for row in figures["rows"]
    }
    assert all(0.0 < row["mpjre_deg"] < row["deg_per_joint"] < 40.0 for row in figures["rows"])
    assert figures["priors"] == {"walk (16_15)": ""}
