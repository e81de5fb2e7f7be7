"""The simulated performer: feet, limits, smoothness, flights, the sword, and that everything can be made again."""

from pathlib import Path

import numpy as np
import pytest
from motion_synthesis import BEHAVIOURS, STYLES, perform, performance
from motion_synthesis.arm_rotations import arm_rest, leg_rest
from motion_synthesis.bodies import body, prototype_bodies, save_bodies
from motion_synthesis.make_assets import clips, motion_of, write_clip, write_performance
from motion_synthesis.proportions import Body
from motion_synthesis.sword import gripping, sword_axes
from perfanim.core.body.calibration_poses import t_pose
from perfanim.core.body.motion import Motion
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.body.standard_skeleton import JOINT_NAMES, default_skeleton
from perfanim.core.errors import SkeletonError
from perfanim.core.geometry import rotations as rot
from perfanim.core.simulate.shipped_performance import load_performance
from perfanim.core.subjects.prototype_bodies import load_bodies
from perfanim.core.system.assets import ASSETS, MOTION, PERFORMANCES

FPS = 60.0
CASES = [(behaviour, style) for behaviour in BEHAVIOURS for style in ("neutral", "energetic", "tired")]
LIMITS_DEG = {"lowerback": 45, "upperback": 45, "thorax": 45, "lowerneck": 35, "upperneck": 35, "head": 35}
LIMITS_DEG |= {
    f"{side}{joint}": most for side in "lr" for joint, most in (("hand", 82), ("wrist", 132), ("clavicle", 40))
}


@pytest.fixture(scope="module")
def motions():
    return {
        (behaviour, style): perform(
            behaviour, 9.0, FPS, body(1.55 + 0.06 * i % 0.4, 0.3, 40 + i), STYLES[style], seed=500 + i
        )
        for i, (behaviour, style) in enumerate(CASES)
    }


def positions_of(motion: Motion, *joints: str) -> list[np.ndarray]:
    positions, _ = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)
    return [positions[:, motion.skeleton.index(joint)] for joint in joints]


def balls_and_heels(motion):
    """Heights of ball and heel above where they rest, and the ball's path, by side."""
    _, world = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)
    result = {}
    for side, ball in zip("lr", positions_of(motion, "ltoes", "rtoes"), strict=True):
        sole = Body(motion.skeleton).sole(side)
        foot = world[:, motion.skeleton.index(f"{side}foot")]
        heel = ball + rot.rotate(rot.multiply(foot, rot.conjugate(sole.flat)), sole.heel_m)
        result[side] = (ball[:, 1] - sole.ball_height_m, heel[:, 1], ball)
    return result


@pytest.mark.parametrize("case", CASES)
def test_feet_neither_sink_nor_slide(motions, case):
    for ball_height, heel_height, ball in balls_and_heels(motions[case]).values():
        assert min(ball_height.min(), heel_height.min()) > -0.002
        planted = np.abs(ball_height) < 0.0002
        still = planted[:-1] & planted[1:]
        # away from the first and last frame of a contact, in which the foot already or still moves
        inside = np.convolve(still, np.ones(5), "same") == 5
        speed = np.linalg.norm(np.diff(ball, axis=0), axis=1) * FPS
        assert inside.mean() > 0.1
        assert speed[inside].max() < 0.01


@pytest.mark.parametrize("case", CASES)
def test_joints_turn_as_people_do(motions, case):
    """Knees and elbows are hinges that bend one way, trunk, neck and wrists have limits, nothing jumps."""
    motion = motions[case]
    turns = np.degrees(rot.to_rotation_vector(motion.rotations))
    for side in "lr":
        knee, elbow = leg_rest(Body(motion.skeleton).sole(side).flat)[1], arm_rest(side)[1]
        for joint, hinge, most in ((f"{side}tibia", knee, 125.0), (f"{side}radius", elbow, 155.0)):
            turn = turns[:, motion.skeleton.index(joint)]
            along = turn @ hinge
            assert np.allclose(turn, along[:, None] * hinge, atol=1e-6)
            assert -1e-6 < along.min() < along.max() < most
    for joint, most in LIMITS_DEG.items():
        assert np.linalg.norm(turns[:, motion.skeleton.index(joint)], axis=1).max() < most, joint
    steps = rot.to_rotation_vector(rot.multiply(rot.conjugate(motion.rotations[:-1]), motion.rotations[1:])) * FPS
    speed = np.degrees(np.linalg.norm(steps, axis=-1))
    acceleration = np.linalg.norm(np.diff(steps, axis=0), axis=-1) * FPS
    # boxers' shoulders and sprinters' knees reach 1000 to 2000 degrees a second; a flip is 10 times that
    assert speed.max() < 2000.0, JOINT_NAMES[int(speed.max(axis=0).argmax())]
    assert acceleration.max() < 1800.0, JOINT_NAMES[int(acceleration.max(axis=0).argmax())]


@pytest.mark.parametrize("behaviour", list(BEHAVIOURS))
def test_performer_stays_in_view_and_mostly_faces_the_cameras(motions, behaviour):
    takes = [motion for (kind, _), motion in motions.items() if kind == behaviour]
    path = np.concatenate([motion.root_positions_m for motion in takes])
    assert np.abs(path[:, 0]).max() < 1.4
    assert np.abs(path[:, 2]).max() < 1.5
    facing = np.concatenate([rot.rotate(motion.rotations[:, 0], [0.0, 0.0, 1.0])[:, 2] for motion in takes])
    assert np.mean(facing > 0.5) > 0.6


@pytest.mark.parametrize("behaviour", ["running", "hopping", "jumping"])
def test_flights_are_ballistic(motions, behaviour):
    motion = motions[(behaviour, "neutral")]
    feet = balls_and_heels(motion)
    free = (feet["l"][0] > 0.001) & (feet["r"][0] > 0.001)
    inside = np.flatnonzero(np.convolve(free, np.ones(3), "same") == 3)
    vertical = np.diff(motion.root_positions_m[:, 1], 2)[inside - 1] * FPS**2
    assert len(inside) > 10
    # the hips give a little where a leg is stretched at take-off or landing
    assert np.median(vertical) == pytest.approx(-9.81, abs=0.1)
    assert np.mean(np.abs(vertical + 9.81) < 0.5) > 0.8


def test_both_hands_hold_one_sword(motions):
    motion = motions[("kendo", "neutral")]
    _, world = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)
    left, right = positions_of(motion, "lhand", "rhand")
    left_turn, right_turn = (world[:, motion.skeleton.index(joint)] for joint in ("lhand", "rhand"))
    still, arm_m = np.zeros((1, 3)), Body(motion.skeleton).arm_m
    wrist, hand = gripping("r", still, still, arm_m)
    # points of the sword so far from the left fist, by the right hand alone
    pommel, tip = (
        right + rot.rotate(right_turn, rot.rotate(rot.conjugate(hand), along_m * sword_axes(still)[0] - wrist)[0])
        for along_m in (-0.04, 1.11)
    )
    from_pommel = left + rot.rotate(left_turn, arm_m * np.array([0.12, -0.035, 0.0])) - pommel
    blade = (tip - pommel) / np.linalg.norm(tip - pommel, axis=1, keepdims=True)
    along = np.sum(from_pommel * blade, axis=1)
    apart = np.linalg.norm(from_pommel - along[:, None] * blade, axis=1)
    held = slice(80, -140)  # after drawing up and before putting away
    assert apart[held].max() < 0.02
    assert np.abs(along[held] - 0.04).max() < 0.02
    assert tip[held, 1].min() > 0.3
    turn = np.arccos(np.clip(np.sum(blade[1:] * blade[:-1], axis=1), -1.0, 1.0))[held]
    assert np.degrees(turn.max()) * FPS < 2000.0


def test_boxer_keeps_the_guard_up_and_strikes_to_an_arms_length():
    motion, fight = perform("boxing", 10.0, seed=901), slice(90, -150)
    (chest,) = positions_of(motion, "upperback")
    reach = []
    for side in "lr":
        hand, shoulder = positions_of(motion, f"{side}hand", f"{side}humerus")
        assert np.mean((hand[:, 1] > chest[:, 1])[fight]) > 0.9
        reach.append(np.linalg.norm(hand - shoulder, axis=1).max())
    assert max(reach) > 0.9 * Body(motion.skeleton).arm_m


def test_walking_looks_like_human_gait():
    motion = perform("walking", 12.0, seed=321)
    speed = np.gradient(motion.root_positions_m[:, 2]) * FPS
    assert 0.6 < speed.max() < 1.6
    knee = np.degrees(rot.angle_between(motion.rotations[:, JOINT_NAMES.index("ltibia")], rot.identity()))
    assert 40.0 < knee.max() < 75.0
    # arms swing with the opposite legs
    to_front = rot.conjugate(motion.rotations[:, 0])
    root, *others = positions_of(motion, "root", "lfoot", "lhand", "rhand")
    foot, same, other = (rot.rotate(to_front, point - root)[:, 2] for point in others)
    assert np.corrcoef(foot, other)[0, 1] > 0.3 > -0.3 > np.corrcoef(foot, same)[0, 1]


def test_no_two_cycles_are_alike():
    motion = perform("running", 9.0, seed=11)
    knee = rot.to_rotation_vector(motion.rotations[:, JOINT_NAMES.index("rtibia")])[:, 0]
    peaks = [i for i in range(1, len(knee) - 1) if knee[i - 1] < knee[i] > knee[i + 1] and knee[i] > 1.2]
    assert len(peaks) >= 6
    assert len(set(np.diff(peaks))) > 1
    assert np.degrees(np.std(knee[peaks])) > 0.5


def test_performance_begins_in_the_t_pose_and_goes_on_without_jumps():
    skeleton = body(1.83, 0.4, 5)
    motion = performance([(behaviour, 3.5) for behaviour in BEHAVIOURS], skeleton=skeleton, seed=8)
    apart = np.degrees(rot.angle_between(motion.rotations[:110], t_pose(skeleton)))
    legs = [JOINT_NAMES.index(side + joint) for side in "lr" for joint in ("femur", "tibia", "foot")]
    assert np.delete(apart, legs, axis=1).mean() < 2.5
    assert apart[:, legs].mean() < 10.0  # nobody's knees are quite straight, nor legs of quite one length
    assert np.linalg.norm(np.ptp(motion.root_positions_m[:110], axis=0)) < 0.05
    steps = np.degrees(rot.angle_between(motion.rotations[:-1], motion.rotations[1:])) * FPS
    assert steps.max() < 2000.0
    assert np.linalg.norm(np.diff(motion.root_positions_m, axis=0), axis=1).max() * FPS < 5.0


def test_rate_changes_only_the_sampling():
    half, whole = (perform("walking", 5.0, fps=fps, seed=6) for fps in (30.0, 120.0))
    assert (half.fps, half.frames) == (30.0, 151)
    assert np.degrees(rot.angle_between(half.rotations, whole.rotations[::4])).max() < 0.5


# ---- building blocks


# ---- bodies and assets


def test_bodies_have_their_height_and_differ_in_proportion(tmp_path: Path):
    plain = body(1.75)
    assert np.allclose(plain.offsets_m, default_skeleton(1.75).offsets_m)
    assert np.allclose(plain.tips_m, default_skeleton(1.75).tips_m)
    bodies = prototype_bodies()
    assert len(bodies) >= 20
    assert np.ptp([Body(b).leg_m / Body(b).arm_m for b in bodies]) > 0.1
    chained = [j for j in range(1, len(plain)) if np.allclose(plain.tips_m[plain.parents[j]], plain.offsets_m[j])]
    for one in bodies:
        assert np.allclose(one.tips_m[one.parents[chained]], one.offsets_m[chained])
    save_bodies(bodies, tmp_path / "b.json")
    again = load_bodies(tmp_path / "b.json")
    assert all(np.allclose(a.offsets_m, b.offsets_m, atol=1e-5) for a, b in zip(bodies, again, strict=True))
    (tmp_path / "b.json").write_text("{}")
    with pytest.raises(SkeletonError, match=r"b\.json"):
        load_bodies(tmp_path / "b.json")


def test_embedded_database_is_what_the_command_makes(tmp_path: Path):
    planned = clips()
    assert sorted(path.stem for path in MOTION.glob("*.bvh")) == sorted(clip.name for clip in planned)
    for clip in (planned[0], planned[-1]):
        write_clip(clip, tmp_path)
        assert (tmp_path / f"{clip.name}.bvh").read_bytes() == (MOTION / f"{clip.name}.bvh").read_bytes()
    save_bodies(prototype_bodies(), tmp_path / "skeletons.json")
    assert (tmp_path / "skeletons.json").read_bytes() == (ASSETS / "skeletons.json").read_bytes()


@pytest.mark.parametrize("name", ["demo", "boxing"])
def test_shipped_performance_is_what_the_command_makes(tmp_path: Path, name: str):
    made = write_performance(name, tmp_path / f"{name}.npz")
    with np.load(tmp_path / f"{name}.npz") as again, np.load(PERFORMANCES / f"{name}.npz") as shipped:
        assert set(again) == set(shipped)
        assert all(np.array_equal(again[key], shipped[key]) for key in again)
    read, start = load_performance(name)
    assert np.degrees(rot.angle_between(made.rotations, read.rotations)).max() < 0.01
    assert np.abs(made.root_positions_m - read.root_positions_m).max() <= 0.5e-4 + 1e-12
    assert start == round(2.9 * FPS)


def test_embedded_database_is_small_and_holds_every_behaviour_and_transitions():
    assert sum(path.stat().st_size for path in MOTION.glob("*.bvh")) < 12e6
    planned = clips()
    for behaviour in BEHAVIOURS:
        assert sum(clip.script[0][0] == behaviour and len(clip.script) == 1 for clip in planned) >= 6
    assert sum(len(clip.script) > 1 for clip in planned) >= 5
    headings = []
    for clip in (clip for clip in planned if clip.name.startswith("walking")):
        facing = rot.rotate(motion_of(clip).rotations[:, 0], [0.0, 0.0, 1.0])
        headings.append(np.degrees(np.unwrap(np.arctan2(facing[:, 0], facing[:, 2]))))
    assert sum(heading.max() > 170.0 for heading in headings) >= 2
    assert sum(heading.min() < -170.0 for heading in headings) >= 2


def test_demo_is_neither_in_the_database_nor_unrelated_to_it():
    demo, _ = load_performance("demo")
    known = np.concatenate([motion_of(clip).rotations[::3, 1:] for clip in clips()[::2]]).astype(np.float32)
    nearest = []
    for pose in demo.rotations[150:-60:12, 1:].astype(np.float32):
        cosines = np.clip(np.abs(np.einsum("njk,jk->nj", known, pose)), 0.0, 1.0)
        nearest.append(np.degrees(np.min(np.mean(2.0 * np.arccos(cosines), axis=1))))
    assert np.min(nearest) > 0.3
    assert 1.0 < np.median(nearest) < 5.0
