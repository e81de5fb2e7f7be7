"""The simulated performer: feet, limits, smoothness, flights, the sword, and that everything can be made again."""

from pathlib import Path

import numpy as np
import pytest
from motion_synthesis import BEHAVIOURS, STYLES, perform, performance
from motion_synthesis.arm_rotations import arm_rest, hanging_arm, leg_rest, two_bones
from motion_synthesis.bodies import body, prototype_bodies, save_bodies
from motion_synthesis.curves import Track, ease, pendulum_filtered
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

SECONDS = 9.0
FPS = 60.0
CASES = [(behaviour, style) for behaviour in BEHAVIOURS for style in ("neutral", "energetic", "tired")]


@pytest.fixture(scope="module")
def motions() -> dict[tuple[str, str], Motion]:
    return {
        (behaviour, style): perform(
            behaviour, SECONDS, FPS, body(1.55 + 0.06 * i % 0.4, 0.3, 40 + i), STYLES[style], seed=500 + i
        )
        for i, (behaviour, style) in enumerate(CASES)
    }


def balls_and_heels(motion: Motion) -> dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Heights of ball and heel above where they rest, and the ball's path, by side."""
    positions, world = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)
    result = {}
    for side in "lr":
        sole = Body(motion.skeleton).sole(side)
        ball = positions[:, motion.skeleton.index(f"{side}toes")]
        foot = world[:, motion.skeleton.index(f"{side}foot")]
        heel = ball + rot.rotate(rot.multiply(foot, rot.conjugate(sole.flat)), sole.heel_m)
        result[side] = (ball[:, 1] - sole.ball_height_m, heel[:, 1], ball)
    return result


@pytest.mark.parametrize("case", CASES)
def test_feet_neither_sink_nor_slide(motions: dict[tuple[str, str], Motion], case: tuple[str, str]) -> None:
    motion = motions[case]
    for ball_height, heel_height, ball in balls_and_heels(motion).values():
        assert ball_height.min() > -0.002
        assert heel_height.min() > -0.002
        planted = np.abs(ball_height) < 0.0002
        still = planted[:-1] & planted[1:]
        # away from the first and last frame of a contact, in which the foot already or still moves
        inside = np.convolve(still, np.ones(5), "same") == 5
        speed = np.linalg.norm(np.diff(ball, axis=0), axis=1) * FPS
        assert inside.mean() > 0.1
        assert speed[inside].max() < 0.01


@pytest.mark.parametrize("case", CASES)
def test_knees_and_elbows_are_hinges_that_bend_one_way(
    motions: dict[tuple[str, str], Motion], case: tuple[str, str]
) -> None:
    motion = motions[case]
    for side in "lr":
        _, knee = leg_rest(Body(motion.skeleton).sole(side).flat)
        _, elbow = arm_rest(side)
        for joint, hinge, most in ((f"{side}tibia", knee, 125.0), (f"{side}radius", elbow, 155.0)):
            turn = np.degrees(rot.to_rotation_vector(motion.rotations[:, motion.skeleton.index(joint)]))
            along = turn @ hinge
            assert np.allclose(turn, along[:, None] * hinge, atol=1e-6)
            assert along.min() > -1e-6
            assert along.max() < most


@pytest.mark.parametrize("case", CASES)
def test_joints_turn_without_jumps(motions: dict[tuple[str, str], Motion], case: tuple[str, str]) -> None:
    motion = motions[case]
    steps = rot.to_rotation_vector(rot.multiply(rot.conjugate(motion.rotations[:-1]), motion.rotations[1:])) * FPS
    speed = np.degrees(np.linalg.norm(steps, axis=-1))
    acceleration = np.linalg.norm(np.diff(steps, axis=0), axis=-1) * FPS
    # boxers' shoulders and sprinters' knees reach 1000 to 2000 degrees a second; a flip is 10 times that
    assert speed.max() < 2000.0, JOINT_NAMES[int(speed.max(axis=0).argmax())]
    assert acceleration.max() < 1800.0, JOINT_NAMES[int(acceleration.max(axis=0).argmax())]


@pytest.mark.parametrize("case", CASES)
def test_trunk_neck_and_wrists_stay_within_human_range(
    motions: dict[tuple[str, str], Motion], case: tuple[str, str]
) -> None:
    motion = motions[case]
    limits = {"lowerback": 45, "upperback": 45, "thorax": 45, "lowerneck": 35, "upperneck": 35, "head": 35}
    limits |= {
        f"{side}{joint}": most for side in "lr" for joint, most in (("hand", 82), ("wrist", 132), ("clavicle", 40))
    }
    for joint, most in limits.items():
        angle = np.degrees(rot.angle_between(motion.rotations[:, motion.skeleton.index(joint)], rot.identity()))
        assert angle.max() < most, joint


@pytest.mark.parametrize("behaviour", list(BEHAVIOURS))
def test_performer_stays_in_view_and_mostly_faces_the_cameras(
    motions: dict[tuple[str, str], Motion], behaviour: str
) -> None:
    takes = [motion for (kind, _), motion in motions.items() if kind == behaviour]
    path = np.concatenate([motion.root_positions_m for motion in takes])
    assert np.abs(path[:, 0]).max() < 1.4
    assert np.abs(path[:, 2]).max() < 1.5
    facing = np.concatenate([rot.rotate(motion.rotations[:, 0], [0.0, 0.0, 1.0])[:, 2] for motion in takes])
    assert np.mean(facing > 0.5) > 0.6


@pytest.mark.parametrize("behaviour", ["running", "hopping", "jumping"])
def test_flights_are_ballistic(motions: dict[tuple[str, str], Motion], behaviour: str) -> None:
    motion = motions[(behaviour, "neutral")]
    feet = balls_and_heels(motion)
    free = (feet["l"][0] > 0.001) & (feet["r"][0] > 0.001)
    inside = np.flatnonzero(np.convolve(free, np.ones(3), "same") == 3)
    vertical = np.diff(motion.root_positions_m[:, 1], 2)[inside - 1] * FPS**2
    assert len(inside) > 10
    # the hips give a little where a leg is stretched at take-off or landing
    assert np.median(vertical) == pytest.approx(-9.81, abs=0.1)
    assert np.mean(np.abs(vertical + 9.81) < 0.5) > 0.8


def sword_in_right_hand(motion: Motion, along_m: float) -> np.ndarray:
    """World positions (F, 3) of the sword's point that far from the left fist to the tip, by the right hand alone."""
    still = np.zeros((1, 3))
    wrist, hand = gripping("r", still, still, Body(motion.skeleton).arm_m)
    in_hand = rot.rotate(rot.conjugate(hand), along_m * sword_axes(still)[0] - wrist)[0]
    positions, world = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)
    joint = motion.skeleton.index("rhand")
    return positions[:, joint] + rot.rotate(world[:, joint], in_hand)


def test_both_hands_hold_one_sword(motions: dict[tuple[str, str], Motion]) -> None:
    motion = motions[("kendo", "neutral")]
    pommel, tip = (sword_in_right_hand(motion, along_m) for along_m in (-0.04, 1.11))
    positions, world = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)
    hand = motion.skeleton.index("lhand")
    size = Body(motion.skeleton).arm_m
    fist = positions[:, hand] + rot.rotate(world[:, hand], size * np.array([0.12, -0.035, 0.0]))
    blade = (tip - pommel) / np.linalg.norm(tip - pommel, axis=1, keepdims=True)
    from_pommel = fist - pommel
    along = np.sum(from_pommel * blade, axis=1)
    apart = np.linalg.norm(from_pommel - along[:, None] * blade, axis=1)
    held = slice(80, -140)  # after drawing up and before putting away
    assert apart[held].max() < 0.02
    assert np.abs(along[held] - 0.04).max() < 0.02
    assert tip[held, 1].min() > 0.3
    turn = np.arccos(np.clip(np.sum(blade[1:] * blade[:-1], axis=1), -1.0, 1.0))[held]
    assert np.degrees(turn.max()) * FPS < 2000.0


def test_boxer_keeps_the_guard_up() -> None:
    motion = perform("boxing", 10.0, seed=901)
    positions, _ = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)
    hands = [positions[:, motion.skeleton.index(f"{side}hand"), 1] for side in "lr"]
    chest = positions[:, motion.skeleton.index("upperback"), 1]
    fight = slice(90, -150)
    assert np.mean((hands[0] > chest)[fight]) > 0.9
    assert np.mean((hands[1] > chest)[fight]) > 0.9
    # blows: the hands come to nearly an arm's length from the shoulders
    reach = [
        np.linalg.norm(
            positions[:, motion.skeleton.index(f"{s}hand")] - positions[:, motion.skeleton.index(f"{s}humerus")], axis=1
        )
        for s in "lr"
    ]
    assert max(r.max() for r in reach) > 0.9 * Body(motion.skeleton).arm_m


def test_walking_looks_like_human_gait() -> None:
    motion = perform("walking", 12.0, seed=321)
    speed = np.gradient(motion.root_positions_m[:, 2]) * FPS
    assert 0.6 < speed.max() < 1.6
    knee = np.degrees(rot.angle_between(motion.rotations[:, JOINT_NAMES.index("ltibia")], rot.identity()))
    assert 40.0 < knee.max() < 75.0
    # arms swing with the opposite legs
    positions, _ = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)
    to_front = rot.conjugate(motion.rotations[:, 0])
    foot = rot.rotate(to_front, positions[:, JOINT_NAMES.index("lfoot")] - positions[:, 0])[:, 2]
    same = rot.rotate(to_front, positions[:, JOINT_NAMES.index("lhand")] - positions[:, 0])[:, 2]
    other = rot.rotate(to_front, positions[:, JOINT_NAMES.index("rhand")] - positions[:, 0])[:, 2]
    assert np.corrcoef(foot, other)[0, 1] > 0.3 > -0.3 > np.corrcoef(foot, same)[0, 1]


def test_no_two_cycles_are_alike() -> None:
    motion = perform("running", 9.0, seed=11)
    knee = rot.to_rotation_vector(motion.rotations[:, JOINT_NAMES.index("rtibia")])[:, 0]
    peaks = [i for i in range(1, len(knee) - 1) if knee[i - 1] < knee[i] > knee[i + 1] and knee[i] > 1.2]
    assert len(peaks) >= 6
    assert len(set(np.diff(peaks))) > 1
    assert np.degrees(np.std(knee[peaks])) > 0.5


def test_performance_begins_in_the_t_pose() -> None:
    skeleton = body(1.83, 0.4, 5)
    motion = performance([("walking", 4.0)], skeleton=skeleton, seed=3)
    still = slice(0, 110)
    apart = np.degrees(rot.angle_between(motion.rotations[still], t_pose(skeleton)))
    legs = [JOINT_NAMES.index(side + joint) for side in "lr" for joint in ("femur", "tibia", "foot")]
    others = [j for j in range(len(JOINT_NAMES)) if j not in legs]
    assert apart[:, others].mean() < 2.5
    assert apart[:, legs].mean() < 10.0  # nobody's knees are quite straight, nor legs of quite one length
    assert np.linalg.norm(np.ptp(motion.root_positions_m[still], axis=0)) < 0.05


def test_behaviours_follow_one_another_without_jumps() -> None:
    motion = performance([(behaviour, 3.5) for behaviour in BEHAVIOURS], seed=8)
    steps = np.degrees(rot.angle_between(motion.rotations[:-1], motion.rotations[1:])) * FPS
    assert steps.max() < 2000.0
    assert np.linalg.norm(np.diff(motion.root_positions_m, axis=0), axis=1).max() * FPS < 5.0


@pytest.mark.parametrize("fps", [24.0, 30.0, 120.0])
def test_rate_changes_only_the_sampling(fps: float) -> None:
    motion = perform("walking", 5.0, fps=fps, seed=6)
    assert motion.fps == fps
    assert abs(motion.duration_s - 5.0) < 1.0 / fps
    whole = perform("walking", 5.0, fps=120.0, seed=6)
    if fps == 30.0:
        assert np.degrees(rot.angle_between(motion.rotations, whole.rotations[::4])).max() < 0.5


# ---- building blocks


def test_track_reproduces_a_ballistic_flight_and_holds_levels() -> None:
    track = Track()
    track.key(0.0, 1.0)
    track.key(1.0, 1.0)
    track.key(1.5, 2.0, 3.0, -9.81)
    track.key(1.9, 2.0 + 3.0 * 0.4 - 0.5 * 9.81 * 0.16, 3.0 - 9.81 * 0.4, -9.81)
    times = np.linspace(1.5, 1.9, 9)
    flight = 2.0 + 3.0 * (times - 1.5) - 0.5 * 9.81 * (times - 1.5) ** 2
    assert np.allclose(track.sample(times)[:, 0], flight, atol=1e-12)
    assert np.allclose(track.sample(np.linspace(0.0, 1.0, 20)), 1.0, atol=1e-12)


def test_pendulum_leads_the_support_and_ends_over_it() -> None:
    times = np.arange(0.0, 8.0, 0.01)
    support = np.where(times < 4.0, 0.0, 0.3)[:, None]
    path = pendulum_filtered(support, 3.1, 0.01)[:, 0]
    assert abs(path[0]) < 1e-3
    assert abs(path[-1] - 0.3) < 1e-3
    assert 0.10 < path[399] < 0.20  # half way when the support changes: the body moved before the foot
    # x'' = w^2 (x - p) away from the step
    inside = slice(300, 380)
    acceleration = np.gradient(np.gradient(path, 0.01), 0.01)[inside]
    assert np.allclose(acceleration, 3.1**2 * path[inside], atol=0.02)
    assert ease(0.5) == pytest.approx(0.5)


def test_two_bones_reach_and_keep_their_lengths() -> None:
    rng = np.random.default_rng(1)
    rest = arm_rest("l")
    start = rng.normal(0.0, 0.1, (50, 3))
    way = rng.standard_normal((50, 3))
    target = start + way / np.linalg.norm(way, axis=1, keepdims=True) * rng.uniform(0.2, 0.52, (50, 1))
    first, flexion_rad = two_bones(start, target, rng.standard_normal((50, 3)), (0.3, 0.28), rest)
    bend = rot.from_rotation_vector(rest[1] * flexion_rad[:, None])
    middle = start + rot.rotate(first, 0.3 * rest[0])
    end = middle + rot.rotate(rot.multiply(first, bend), 0.28 * rest[0])
    assert np.allclose(end, target, atol=1e-6)


@pytest.mark.parametrize("side", ["l", "r"])
def test_arm_angles_include_the_rest_pose_and_hanging(side: str) -> None:
    s = 1.0 if side == "l" else -1.0
    zero = np.zeros(1)
    rest = hanging_arm(side, zero, zero + np.pi / 2, zero - np.pi / 6)
    assert np.allclose(np.abs(rest), rot.identity((1,)), atol=1e-9)
    hanging = hanging_arm(side, zero, zero, zero)
    assert np.allclose(rot.rotate(hanging, [s, 0.0, 0.0]), [[0.0, -1.0, 0.0]], atol=1e-9)
    forward = hanging_arm(side, zero + np.pi / 2, zero, zero)
    assert np.allclose(rot.rotate(forward, [s, 0.0, 0.0]), [[0.0, 0.0, 1.0]], atol=1e-9)


# ---- bodies and assets


def test_bodies_have_their_height_and_differ_in_proportion(tmp_path: Path) -> None:
    plain = body(1.75)
    assert np.allclose(plain.offsets_m, default_skeleton(1.75).offsets_m)
    assert np.allclose(plain.tips_m, default_skeleton(1.75).tips_m)
    bodies = prototype_bodies()
    assert len(bodies) >= 20
    legs = np.array([Body(b).leg_m / Body(b).arm_m for b in bodies])
    assert np.ptp(legs) > 0.1
    for one in bodies:
        joints = range(1, len(one))
        chained = [j for j in joints if np.allclose(plain.tips_m[plain.parents[j]], plain.offsets_m[j])]
        assert all(np.allclose(one.tips_m[one.parents[j]], one.offsets_m[j]) for j in chained)
    save_bodies(bodies, tmp_path / "b.json")
    again = load_bodies(tmp_path / "b.json")
    assert all(np.allclose(a.offsets_m, b.offsets_m, atol=1e-5) for a, b in zip(bodies, again, strict=True))
    (tmp_path / "b.json").write_text("{}")
    with pytest.raises(SkeletonError, match=r"b\.json"):
        load_bodies(tmp_path / "b.json")


def test_embedded_database_is_what_the_command_makes(tmp_path: Path) -> None:
    planned = clips()
    assert sorted(path.stem for path in MOTION.glob("*.bvh")) == sorted(clip.name for clip in planned)
    for clip in (planned[0], planned[-1]):
        write_clip(clip, tmp_path)
        assert (tmp_path / f"{clip.name}.bvh").read_bytes() == (MOTION / f"{clip.name}.bvh").read_bytes()
    save_bodies(prototype_bodies(), tmp_path / "skeletons.json")
    assert (tmp_path / "skeletons.json").read_bytes() == (ASSETS / "skeletons.json").read_bytes()


@pytest.mark.parametrize("name", ["demo", "boxing"])
def test_shipped_performance_is_what_the_command_makes(tmp_path: Path, name: str) -> None:
    made = write_performance(name, tmp_path / f"{name}.npz")
    with np.load(tmp_path / f"{name}.npz") as again, np.load(PERFORMANCES / f"{name}.npz") as shipped:
        assert set(again) == set(shipped)
        assert all(np.array_equal(again[key], shipped[key]) for key in again)
    read, start = load_performance(name)
    assert np.degrees(rot.angle_between(made.rotations, read.rotations)).max() < 0.01
    assert np.abs(made.root_positions_m - read.root_positions_m).max() <= 0.5e-4 + 1e-12
    assert start == round(2.9 * FPS)


def test_embedded_database_is_small_and_holds_every_behaviour_and_transitions() -> None:
    files = list(MOTION.glob("*.bvh"))
    assert sum(path.stat().st_size for path in files) < 12e6
    planned = clips()
    for behaviour in BEHAVIOURS:
        assert sum(clip.script[0][0] == behaviour and len(clip.script) == 1 for clip in planned) >= 6
    assert sum(len(clip.script) > 1 for clip in planned) >= 5
    assert {clip.style for clip in planned} <= set(STYLES)
    headings = []
    for clip in (clip for clip in planned if clip.name.startswith("walking")):
        facing = rot.rotate(motion_of(clip).rotations[:, 0], [0.0, 0.0, 1.0])
        headings.append(np.degrees(np.unwrap(np.arctan2(facing[:, 0], facing[:, 2]))))
    assert sum(heading.max() > 170.0 for heading in headings) >= 2
    assert sum(heading.min() < -170.0 for heading in headings) >= 2


def test_demo_is_neither_in_the_database_nor_unrelated_to_it() -> None:
    demo, _ = load_performance("demo")
    known = np.concatenate([motion_of(clip).rotations[::3, 1:] for clip in clips()[::2]]).astype(np.float32)
    nearest = []
    for pose in demo.rotations[150:-60:12, 1:].astype(np.float32):
        cosines = np.clip(np.abs(np.einsum("njk,jk->nj", known, pose)), 0.0, 1.0)
        nearest.append(np.degrees(np.min(np.mean(2.0 * np.arccos(cosines), axis=1))))
    assert np.min(nearest) > 0.3
    assert 1.0 < np.median(nearest) < 5.0
