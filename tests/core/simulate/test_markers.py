import json
from pathlib import Path

import numpy as np
import pytest
from perfanim.core.body.motion import Motion
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.cli.main import main
from perfanim.core.errors import MarkerSetError, SettingsError, SkeletonError
from perfanim.core.formats.markers.marker_files import read_take
from perfanim.core.formats.motion.bvh import write_bvh
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.geometry import rotations as rot
from perfanim.core.markers.marker_set import Marker, MarkerSet, load_marker_set
from perfanim.core.markers.subject import Subject
from perfanim.core.simulate.simulated_markers import simulate_markers

SET = MarkerSet(
    "three", (Marker("A", "root", (0.1, 0.0, 0.0), True), Marker("B", "lhand", (0.0, 0.02, 0.0), True),
              Marker("C", "head", (0.0, 0.1, 0.1), True)),
)  # fmt: skip


def turning(frames: int = 400) -> Motion:
    skeleton = default_skeleton()
    turn = np.linspace(0.0, 1.0, frames)[:, None, None] * np.linspace(-0.4, 0.4, len(skeleton))[:, None]
    rotations = rot.from_rotation_vector(turn * np.array([0.5, 0.7, 0.3]))
    return Motion("turning", 60.0, skeleton, rotations, np.tile([0.0, 1.0, 0.0], (frames, 1)))


def test_markers_are_fixed_to_their_joints() -> None:
    motion = turning(20)
    take, truth = simulate_markers(motion, SET)
    assert truth is motion
    assert take.names == ("A", "B", "C")
    assert take.fps == motion.fps
    positions, world = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)
    hand = motion.skeleton.index("lhand")
    expected = positions[:, hand] + rot.rotate(world[:, hand], np.array([0.0, 0.02, 0.0]))
    np.testing.assert_allclose(take.positions_m[:, 1], expected, atol=1e-12)


def test_noise_has_the_asked_size_and_repeats_with_its_seed() -> None:
    motion = turning(2000)
    clean, _ = simulate_markers(motion, SET)
    noisy, _ = simulate_markers(motion, SET, noise_mm=2.0, seed=4)
    again, _ = simulate_markers(motion, SET, noise_mm=2.0, seed=4)
    other, _ = simulate_markers(motion, SET, noise_mm=2.0, seed=5)
    spread = np.std(noisy.positions_m - clean.positions_m)
    # the standard error of a standard deviation over n samples is s / sqrt(2 n); five of them
    assert abs(spread - 0.002) < 5.0 * 0.002 / np.sqrt(2.0 * clean.positions_m.size)
    np.testing.assert_array_equal(noisy.positions_m, again.positions_m)
    assert not np.array_equal(noisy.positions_m, other.positions_m)


def test_dropout_has_the_asked_share_in_gaps() -> None:
    take, _ = simulate_markers(turning(20000), SET, dropout=0.2, seed=1)
    missing = ~take.visible
    assert missing.mean() == pytest.approx(0.2, abs=0.03)
    starts = np.sum(missing[1:] & ~missing[:-1])
    assert missing.sum() / starts == pytest.approx(0.15 * 60.0, rel=0.15)


def test_a_subjects_offsets_are_taken() -> None:
    motion = turning(3)
    subject = Subject("S", motion.skeleton, SET.with_offsets(np.full((3, 3), 0.05)))
    take, _ = simulate_markers(motion, subject)
    expected, _ = simulate_markers(motion, subject.marker_set)
    np.testing.assert_array_equal(take.positions_m, expected.positions_m)


def test_bad_settings_are_refused() -> None:
    motion = turning(3)
    for settings in ({"noise_mm": -1.0}, {"noise_mm": float("nan")}, {"dropout": 1.0}, {"dropout": -0.1}):
        with pytest.raises(SettingsError):
            simulate_markers(motion, SET, **settings)
    with pytest.raises(SkeletonError, match="no joint 'tail'"):
        simulate_markers(motion, MarkerSet("t", (*SET.markers, Marker("D", "tail", (0.0, 0.0, 0.0)))))
    with pytest.raises(MarkerSetError, match="no offset for D"):
        simulate_markers(motion, MarkerSet("t", (*SET.markers, Marker("D", "head"))))


@pytest.mark.parametrize("name", ["locomotion", "boxing", "kendo"])
def test_shipped_marker_sets_can_be_simulated(name: str) -> None:
    take, _ = simulate_markers(turning(3), load_marker_set(name))
    assert np.all(take.visible)


@pytest.mark.parametrize("ending", [".take.npz", ".csv", ".trc"])
def test_command_writes_take_and_truth(tmp_path: Path, ending: str, capsys: pytest.CaptureFixture[str]) -> None:
    motion = turning(30)
    write_bvh(motion, tmp_path / "m.bvh")
    out = tmp_path / f"walk{ending}"
    line = ["simulate", "markers", str(tmp_path / "m.bvh"), "--marker-set", "boxing", "--out", str(out), "--fps", "30"]
    assert main([*line, "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    take = read_take(out)
    assert summary["frames"] == take.frames == 15
    assert summary["truth"] == str(tmp_path / "walk.truth.bvh")
    truth = read_motion(summary["truth"])
    expected, _ = simulate_markers(truth, load_marker_set("boxing"))
    np.testing.assert_allclose(take.positions_m, expected.positions_m, atol=2e-6)
    np.testing.assert_allclose(truth.root_positions_m, motion.root_positions_m[::2][:15], atol=1e-6)
