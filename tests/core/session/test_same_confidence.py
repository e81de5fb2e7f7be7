"""Confidence in the same pictures: shown live, and in the recorded take."""

from pathlib import Path

import numpy as np
import pytest
from perfanim.core.api.solving import SolveRequest, solve
from perfanim.core.cli.main import main
from perfanim.core.formats.markers.marker_files import read_take
from perfanim.core.formats.take_file.take_reader import read_take_file
from perfanim.core.geometry.rig_file import save_rig
from perfanim.core.markers.subject import load_subject
from two_webcams import published_rig

MARKERS = "two-webcams"


@pytest.mark.long
def test_pictures_of_two_webcams_are_as_certain_live_as_imported(shared_dir: Path, tmp_path: Path) -> None:
    """All 444 pairs of the fourth sequence, with the starter database, as an animator has them."""
    recorded = shared_dir / "two-webcams"
    rig, level, subject = tmp_path / "cameras.toml", tmp_path / "level.toml", tmp_path / "anna.toml"
    points, blobs = tmp_path / "walk.take.npz", tmp_path / "seen.perftake"
    save_rig(published_rig(recorded), rig)
    seen = recorded / "sequence4"
    pictures = ["--left", seen / "*_1.jpg", "--right", seen / "*_2.jpg"]
    worn = ("--marker-set", MARKERS)
    for words in (
        ("track", "--cameras", rig, *pictures, *worn, "--floor", "feet", "--floor-cameras", level, "--out", points),
        ("calibrate", "subject", points, *worn, "--database", "starter", "--height", 1.6, "--out", subject),
        ("track", "--cameras", level, *pictures, "--out", blobs),
    ):
        assert main([str(word) for word in words]) == 0
    worn_by, live = load_subject(subject), SolveRequest(causal=True)
    solved = [
        solve(read_take_file(blobs), worn_by, "starter", live),
        solve(read_take_file(blobs), worn_by, "starter"),
        solve(read_take(points), worn_by, "starter"),
    ]
    confidences = [np.mean([pose.confidence for pose in each.poses_of()]) for each in solved]
    assert min(confidences) > 0.5
    assert np.ptp(confidences) < 0.1
