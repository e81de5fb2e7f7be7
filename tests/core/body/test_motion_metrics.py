import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from perfanim.core.body.joint_angle_frames import angle_frame, with_angle_frames
from perfanim.core.body.motion import Motion, resampled, sliced
from perfanim.core.body.motion_metrics import evaluate
from perfanim.core.body.skeleton import Skeleton
from perfanim.core.body.standard_skeleton import JOINT_NAMES, default_skeleton
from perfanim.core.cli.main import main
from perfanim.core.errors import FormatError
from perfanim.core.formats.motion.asf import read_asf
from perfanim.core.formats.motion.bvh import write_bvh
from perfanim.core.geometry import rotations as rot


def walking_on_the_spot(frames: int = 121, fps: float = 60.0) -> Motion:
    skeleton = with_angle_frames(default_skeleton())
    time = np.arange(frames) / fps
    rotations = rot.identity((frames, len(skeleton)))
    for name, phase in (("lfemur", 0.0), ("rfemur", np.pi), ("lhumerus", np.pi), ("rhumerus", 0.0)):
        swing = 0.5 * np.sin(2.0 * np.pi * time + phase)
        rotations[:, skeleton.index(name)] = rot.from_rotation_vector(np.outer(swing, [1.0, 0.0, 0.0]))
    path = np.tile([0.0, 0.95, 0.0], (frames, 1)) + np.outer(0.02 * np.sin(4.0 * np.pi * time), [0.0, 1.0, 0.0])
    return Motion("walk", fps, skeleton, rotations, path)


def turned(motion: Motion, joint: str, degrees: float, axis: tuple[float, float, float]) -> Motion:
    rotations = motion.rotations.copy()
    extra = rot.from_rotation_vector(np.radians(degrees) * np.array(axis))
    rotations[:, motion.skeleton.index(joint)] = rot.multiply(rotations[:, motion.skeleton.index(joint)], extra)
    return replace(motion, rotations=rotations)


def test_the_truth_itself_has_no_error() -> None:
    motion = walking_on_the_spot()
    result = evaluate(motion, motion)
    for key in ("deg_per_joint", "deg_per_angle", "mpjpe_mm", "bone_direction_deg", "twist_deg", "root_position_mm"):
        assert result[key] == pytest.approx(0.0, abs=1e-5)
    assert result["jitter_ratio"] == pytest.approx(1.0)
    assert result["foot_skate_cm_s"] == pytest.approx(result["foot_skate_truth_cm_s"], nan_ok=True)
    assert result["notes"] == []


def test_one_turned_joint_counts_for_itself() -> None:
    truth = walking_on_the_spot()
    result = evaluate(turned(truth, "lfemur", 10.0, (1.0, 0.0, 0.0)), truth)
    assert result["deg_per_joint"] == pytest.approx(10.0 / 28.0, rel=1e-6)
    assert result["per_joint"]["lfemur"]["deg"] == pytest.approx(10.0)
    assert result["per_joint"]["ltibia"]["deg"] == pytest.approx(0.0, abs=1e-6)
    # the shank follows in the world, the other leg does not
    assert result["per_joint"]["ltibia"]["bone_direction_deg"] > 5.0
    assert result["per_joint"]["rtibia"]["bone_direction_deg"] == pytest.approx(0.0, abs=1e-6)
    knee = np.linalg.norm(truth.skeleton.tips_m[truth.skeleton.index("lfemur")])
    tilt = 1.0 - (0.342 * 1.0) ** 2  # share of the thigh across the turning axis, squared
    expected = 1000.0 * knee * 2.0 * np.sin(np.radians(5.0)) * np.sqrt(tilt)
    assert result["per_joint"]["ltibia"]["position_mm"] == pytest.approx(expected, rel=1e-3)
    assert result["worst_frames"][0]["deg_per_joint"] == pytest.approx(10.0 / 28.0, rel=1e-6)


def test_twist_and_direction_are_apart() -> None:
    truth = walking_on_the_spot()
    result = evaluate(turned(truth, "lhumerus", 20.0, (1.0, 0.0, 0.0)), truth)
    assert result["per_joint"]["lhumerus"]["twist_deg"] == pytest.approx(20.0, abs=1e-4)
    assert result["per_joint"]["lhumerus"]["bone_direction_deg"] == pytest.approx(0.0, abs=1e-4)
    result = evaluate(turned(truth, "lhumerus", 20.0, (0.0, 1.0, 0.0)), truth)
    assert result["per_joint"]["lhumerus"]["twist_deg"] == pytest.approx(0.0, abs=1e-4)
    assert result["per_joint"]["lhumerus"]["bone_direction_deg"] == pytest.approx(20.0, abs=1e-4)


def test_hands_head_and_feet_are_no_main_bones() -> None:
    truth = walking_on_the_spot()
    for joint in ("lhand", "head", "rfoot"):
        result = evaluate(turned(truth, joint, 20.0, (0.0, 0.0, 1.0)), truth)
        assert result["bone_direction_deg"] > 0.1
        assert result["main_bone_direction_deg"] == pytest.approx(0.0, abs=1e-6)
    # 3 of the spine, 3 of each arm, 2 of each leg
    result = evaluate(turned(truth, "ltibia", 20.0, (0.0, 0.0, 1.0)), truth)
    shank = result["per_joint"]["ltibia"]["bone_direction_deg"]
    assert result["main_bone_direction_deg"] == pytest.approx(shank / 13.0)


def test_angles_are_the_skeletons_own() -> None:
    truth = walking_on_the_spot()
    frame, order = angle_frame("lradius")
    assert order == "X"
    hinge = rot.rotate(frame, np.array([1.0, 0.0, 0.0]))
    result = evaluate(turned(truth, "lradius", 15.0, tuple(hinge)), truth)
    angles = sum(len(order) for order in truth.skeleton.angle_orders[1:])
    assert result["per_joint"]["lradius"]["deg_per_angle"] == pytest.approx(15.0)
    assert result["deg_per_angle"] == pytest.approx(15.0 / angles)


def test_angles_wrap_and_flipped_triples_are_one_rotation() -> None:
    truth = walking_on_the_spot(8)
    joint = truth.skeleton.index("lhumerus")
    frame, _ = angle_frame("lhumerus")
    both = []
    for middle, last in ((89.0, 10.0), (91.0, 10.0)):  # either side of the middle angle's end
        rotations = truth.rotations.copy()
        inner = rot.from_euler(np.radians([30.0, middle, last]), "ZYX")
        rotations[:, joint] = rot.multiply(rot.multiply(frame, inner), rot.conjugate(frame))
        both.append(replace(truth, rotations=rotations))
    result = evaluate(both[0], both[1])
    assert result["per_joint"]["lhumerus"]["deg_per_angle"] == pytest.approx(2.0 / 3.0, abs=1e-6)


def test_root_errors_are_apart_from_the_body() -> None:
    truth = walking_on_the_spot()
    moved = replace(truth, root_positions_m=truth.root_positions_m + np.array([0.03, 0.0, 0.04]))
    result = evaluate(moved, truth)
    assert result["mpjpe_mm"] == pytest.approx(0.0, abs=1e-9)
    assert result["mpjpe_absolute_mm"] == pytest.approx(50.0)
    assert result["root_position_mm"] == pytest.approx(50.0)
    assert result["deg_per_joint"] == 0.0


def test_noise_raises_the_jitter_by_what_it_adds() -> None:
    truth = walking_on_the_spot(600)
    noise = np.random.default_rng(0).normal(0.0, 0.001, truth.root_positions_m.shape)
    result = evaluate(replace(truth, root_positions_m=truth.root_positions_m + noise), truth)
    # the third difference of white noise has 1 + 9 + 9 + 1 times its variance; a 3D normal's mean length is 1.596 s
    added = 0.001 * np.sqrt(20.0) * 1.596
    own = evaluate(truth, truth)["jitter_ratio"]
    assert own == pytest.approx(1.0)
    assert result["jitter_ratio"] > 10.0
    still = replace(truth, rotations=np.repeat(truth.rotations[:1], 600, axis=0), root_positions_m=np.zeros((600, 3)))
    shaken = replace(still, root_positions_m=noise)
    reference = replace(still, root_positions_m=noise * 0.5)
    assert evaluate(shaken, reference)["jitter_ratio"] == pytest.approx(2.0)
    third = np.linalg.norm(np.diff(noise, 3, axis=0), axis=-1).mean()
    assert third == pytest.approx(added, rel=0.1)
    assert np.isnan(evaluate(shaken, still)["jitter_ratio"])


def test_foot_skate_is_the_speed_of_feet_that_should_stand() -> None:
    skeleton = with_angle_frames(default_skeleton())
    still = Motion("still", 50.0, skeleton, rot.identity((60, 29)), np.tile([0.0, 0.95, 0.0], (60, 1)))
    drift = np.arange(60)[:, None] * np.array([0.001, 0.0, 0.0])
    result = evaluate(replace(still, root_positions_m=still.root_positions_m + drift), still)
    assert result["foot_skate_cm_s"] == pytest.approx(5.0)
    assert result["foot_skate_truth_cm_s"] == 0.0
    jumping = replace(
        still, root_positions_m=still.root_positions_m + np.arange(60)[:, None] * np.array([0.0, 0.1, 0.0])
    )
    assert np.isnan(evaluate(still, jumping)["foot_skate_cm_s"])


def test_other_rates_and_lengths_are_compared_and_told() -> None:
    truth = walking_on_the_spot(241, 120.0)
    motion = sliced(resampled(truth, 60.0), 0, 50)
    result = evaluate(motion, truth)
    assert result["frames"] == 50
    assert result["deg_per_joint"] == pytest.approx(0.0, abs=1e-5)
    assert result["notes"] == [
        "truth resampled from 120 to 60 frames per second",
        "motion has 50 frames (0.82 s), truth 121 (2.00 s); the first 50 are compared",
    ]


def test_joints_that_one_lacks_are_left_out() -> None:
    truth = walking_on_the_spot(20)
    kept = [i for i, name in enumerate(JOINT_NAMES) if name[1:] not in ("thumb", "fingers")]
    old = truth.skeleton
    skeleton = Skeleton(
        tuple(JOINT_NAMES[i] for i in kept), np.array([kept.index(p) if p >= 0 else -1 for p in old.parents[kept]]),
        old.offsets_m[kept], old.tips_m[kept], old.angle_axes[kept], tuple(old.angle_orders[i] for i in kept),
    )  # fmt: skip
    motion = Motion("fewer", 60.0, skeleton, truth.rotations[:, kept], truth.root_positions_m)
    result = evaluate(motion, truth)
    assert result["joints"] == 25
    assert result["mpjpe_mm"] == pytest.approx(0.0, abs=1e-6)
    assert result["notes"] == ["only the 25 joints that both have are compared"]


def test_nothing_in_common_is_refused() -> None:
    truth = walking_on_the_spot(5)
    other = Skeleton(("a", "b"), np.array([-1, 0]), np.zeros((2, 3)), np.ones((2, 3)))
    motion = Motion("other", 60.0, other, rot.identity((5, 2)), np.zeros((5, 3)))
    with pytest.raises(FormatError, match="share fewer than two joints"):
        evaluate(motion, truth)


def test_angle_frames_are_those_of_the_cmu_files(cmu_dir: Path) -> None:
    for path in sorted(cmu_dir.glob("*/*.asf")):
        skeleton = read_asf(path).skeleton
        ours = with_angle_frames(default_skeleton())
        assert np.degrees(rot.angle_between(skeleton.angle_axes, ours.angle_axes)).max() < 1e-6
        assert skeleton.angle_orders == ours.angle_orders


def test_command(tmp_path: Path, cmu_dir: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def evaluated(*line: object) -> dict[str, Any]:
        assert main(["evaluate", *map(str, line), "--json"]) == 0
        return dict(json.loads(capsys.readouterr().out))

    motion = walking_on_the_spot()
    write_bvh(motion, tmp_path / "a.bvh")
    write_bvh(turned(motion, "lfemur", 10.0, (1.0, 0.0, 0.0)), tmp_path / "b.bvh")
    result = evaluated(tmp_path / "b.bvh", "--truth", tmp_path / "a.bvh")
    assert result["deg_per_joint"] == pytest.approx(10.0 / 28.0, abs=1e-4)
    asf, amc = cmu_dir / "16" / "16.asf", cmu_dir / "16" / "16_16.amc"
    assert evaluated(amc, "--truth", amc, "--skeleton", asf)["deg_per_angle"] == 0.0
