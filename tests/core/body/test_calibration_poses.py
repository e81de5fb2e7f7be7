from dataclasses import replace

import numpy as np
import pytest
from motion_synthesis.bodies import prototype_bodies
from perfanim.core.body.calibration_poses import CALIBRATION, POSES, hanging, motorcycle, standing, t_pose
from perfanim.core.body.motion import Motion
from perfanim.core.body.skeleton import Skeleton, forward_kinematics
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.geometry import rotations as rot
from perfanim.core.simulate.studio.render import Renderer
from perfanim.core.simulate.studio.simulated_source import simulated_source
from perfanim.core.simulate.studio.stage_placement import lowest_point_m
from perfanim.core.simulate.studio.studio_rig import default_rig

BODIES = [default_skeleton(), *prototype_bodies(6)]


@pytest.mark.parametrize("skeleton", BODIES)
def test_legs_hang_and_arms_are_level(skeleton: Skeleton) -> None:
    positions, _ = forward_kinematics(skeleton, t_pose(skeleton), np.zeros(3))
    at = dict(zip(skeleton.names, positions, strict=True))
    for side, sign in (("l", 1.0), ("r", -1.0)):
        for upper, lower in (("femur", "tibia"), ("tibia", "foot")):
            bone = at[side + lower] - at[side + upper]
            assert abs(bone[0]) < 0.01 * np.linalg.norm(bone)  # straight down as seen from the front
            assert bone[1] < 0.0
        arm = at[side + "hand"] - at[side + "humerus"]
        assert sign * arm[0] > 0.999 * np.linalg.norm(arm)
        toes = at[side + "toes"] - at[side + "foot"]
        assert toes[2] > 0.8 * np.linalg.norm(toes)
    assert at["lfoot"][1] == pytest.approx(at["rfoot"][1], abs=0.02)


def test_arms_hang_when_standing() -> None:
    skeleton = default_skeleton()
    positions, _ = forward_kinematics(skeleton, standing(skeleton), np.zeros(3))
    at = dict(zip(skeleton.names, positions, strict=True))
    for side in "lr":
        arm = at[side + "hand"] - at[side + "humerus"]
        np.testing.assert_allclose(arm / np.linalg.norm(arm), [0.0, -1.0, 0.0], atol=1e-6)
    assert at["lhand"][0] > 0.1 > -0.1 > at["rhand"][0]


@pytest.mark.parametrize("skeleton", BODIES)
def test_knees_bent_over_flat_feet_and_arms_forward_on_a_motorcycle(skeleton: Skeleton) -> None:
    positions, world = forward_kinematics(skeleton, motorcycle(skeleton), np.zeros(3))
    flat = forward_kinematics(skeleton, t_pose(skeleton), np.zeros(3))[1]
    at = dict(zip(skeleton.names, positions, strict=True))
    for side in "lr":
        thigh, shank = at[side + "tibia"] - at[side + "femur"], at[side + "foot"] - at[side + "tibia"]
        bend = thigh @ shank / np.linalg.norm(thigh) / np.linalg.norm(shank)
        assert np.degrees(np.arccos(bend)) == pytest.approx(60.0, abs=1e-6)
        assert thigh[2] > 0.0 > shank[2]
        # thigh and shank of a person differ by some percent, and so far the ankle is from below the hip
        assert abs(at[side + "foot"][2] - at[side + "femur"][2]) < 0.05
        foot = skeleton.index(side + "foot")
        np.testing.assert_allclose(rot.angle_between(world[foot], flat[foot]), 0.0, atol=1e-6)
        arm = at[side + "hand"] - at[side + "humerus"]
        low = np.radians(20.0)
        np.testing.assert_allclose(arm / np.linalg.norm(arm), [0.0, -np.sin(low), np.cos(low)], atol=1e-6)
        palm = rot.rotate(world[skeleton.index(side + "hand")], [0.0, -1.0, 0.0])
        np.testing.assert_allclose(palm, [0.0, -np.cos(low), -np.sin(low)], atol=1e-6)


def test_every_marker_is_seen_by_both_cameras_in_every_calibration_pose() -> None:
    """Hands must not hide shoulders, nor the body hands: a hidden marker leaves open what its limb is measured by."""
    renderer = Renderer(default_rig())
    for skeleton in BODIES[1::2]:
        for name in CALIBRATION:
            pose = POSES[name](skeleton)
            motion = Motion(name, 60.0, skeleton, np.stack((pose, pose)), np.zeros((2, 3)))
            standing_on_floor = replace(motion, root_positions_m=np.tile([0.0, -lowest_point_m(motion), 0.0], (2, 1)))
            source = simulated_source(standing_on_floor, "boxing", renderer)
            assert source.frame(0).truth.visible.all(), name


def test_hanging_arms_stay_off_the_body() -> None:
    skeleton = default_skeleton()
    positions, _ = forward_kinematics(skeleton, hanging(skeleton), np.zeros(3))
    at = dict(zip(skeleton.names, positions, strict=True))
    for side, sign in (("l", 1.0), ("r", -1.0)):
        arm = at[side + "hand"] - at[side + "humerus"]
        aside = np.radians(15.0)
        np.testing.assert_allclose(arm / np.linalg.norm(arm), [sign * np.sin(aside), -np.cos(aside), 0.0], atol=1e-6)
