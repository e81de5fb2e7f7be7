"""Whole bodies from keys: met, held to the floor, alone, impossible, edited."""

from dataclasses import replace

import numpy as np
import pytest
from bench.sketch import CONTROLS, inverse_kinematics, sketch_of
from perfanim.core.body.calibration_poses import standing
from perfanim.core.body.motion import sliced
from perfanim.core.body.motion_metrics import evaluate
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.database.store import pose_from_rotations
from perfanim.core.errors import DatabaseError, SettingsError
from perfanim.core.geometry import rotations as rot
from perfanim.core.sketch.reach import Reach
from perfanim.core.sketch.sketch_file import Control, Sketch
from perfanim.core.sketch.solve_sketch import LIMITS, SketchSettings, SketchSolver

FIVE = CONTROLS["five"]
MOST_BEND_RAD = 0.45  # beyond the database's angles: what the fit allows, and its margin
FASTEST_M_S = 25.0


@pytest.fixture(scope="module")
def solver(truth, database):
    return SketchSolver(truth.skeleton, database)


@pytest.fixture(scope="module")
def walk(truth):
    return sketch_of(truth, FIVE, "16")


def positions_of(motion):
    return forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)[0]


def changed(sketch, joint, change):
    """Return a sketch with the positions of one control changed."""
    controls = [replace(c, positions_m=change(c.positions_m)) if c.joint == joint else c for c in sketch.controls]
    return replace(sketch, controls=tuple(controls))


def assert_sound(solution, database):
    """Check that a motion is a body's: finite, no joint wrung, no jump."""
    motion = solution.motion
    reference = database.reference_pose_of(motion.skeleton)
    poses = pose_from_rotations(motion.rotations, reference).reshape(motion.frames, -1)
    known = database.poses.reshape(database.frames, -1)
    assert np.isfinite(motion.rotations).all()
    assert np.isfinite(motion.root_positions_m).all()
    assert (poses > known.min(axis=0) - MOST_BEND_RAD).all()
    assert (poses < known.max(axis=0) + MOST_BEND_RAD).all()
    speeds = np.linalg.norm(np.diff(positions_of(motion), axis=0), axis=-1) * motion.fps
    assert speeds.max(initial=0.0) < FASTEST_M_S


def test_keys_are_met_and_the_body_between_them_is_nearer_than_by_usual_ik(truth, solver, walk):
    solution = solver.solve(walk)
    assert solution.unmet == ()
    assert solution.key_distances_m.max() < LIMITS.met_m
    assert len(solution.key_distances_m) == sum(len(control.frames) for control in walk.controls)
    ours = evaluate(solution.motion, truth)
    usual = evaluate(inverse_kinematics(walk, truth.skeleton), truth)
    assert ours["mpjpe_mm"] < 0.6 * usual["mpjpe_mm"]
    assert ours["jitter_ratio"] < 1.3
    assert ours["foot_skate_cm_s"] < 6.0


def test_standing_feet_are_held_unless_set_free(truth, solver, walk):
    hips = sketch_of(truth, ("root",), "16")
    held, free = (
        evaluate(solver.solve(hips, SketchSettings(hold_feet=hold)).motion, truth)["foot_skate_cm_s"]
        for hold in (True, False)
    )
    assert held < 0.5 * free


@pytest.mark.parametrize("joints", [("rhand",), ("root",), ("lfoot", "rfoot"), ("head", "ltoes")])
def test_any_few_controls_are_enough(truth, solver, database, joints):
    solution = solver.solve(sketch_of(truth, joints, "16"))
    assert solution.unmet == ()
    assert_sound(solution, database)


def test_feet_alone_carry_the_body_along(truth, solver):
    motion = solver.solve(sketch_of(truth, ("lfoot", "rfoot"), "16")).motion
    way = motion.root_positions_m - truth.root_positions_m
    assert np.linalg.norm(way[:, [0, 2]], axis=1).max() < 0.15


def test_body_stays_about_where_it_is_while_nothing_is_keyed(truth, solver, database):
    early, late = (sketch_of(truth, (joint,), "16").controls[0] for joint in ("root", "rhand"))
    later = replace(late, frames=late.frames + 150.0, positions_m=late.positions_m + np.array([0.0, 0.0, 1.0]))
    solution = solver.solve(Sketch("pause", 30.0, (early, later)))
    assert solution.unmet == ()
    assert_sound(solution, database)
    places = solution.motion.root_positions_m[:, [0, 2]]
    keyed = np.concatenate((early.positions_m, later.positions_m))[:, [0, 2]]
    nearest = np.linalg.norm(places[:, None] - keyed, axis=2).min(axis=1)
    assert nearest.max() < 1.5


def test_a_control_binds_no_key_of_others_before_its_own(truth, solver):
    """The chest's only keys, a second after the first of hips and feet, are 12 cm from its place."""
    sketch = sketch_of(truth, ("root", "lfoot", "rfoot", "thorax"), "16")
    late = sketch.frames[0] + truth.fps
    controls = []
    for control in sketch.controls:
        if control.joint == "thorax":
            kept = control.frames >= late
            control = Control("thorax", control.frames[kept], control.positions_m[kept] + np.array([0.0, 0.12, 0.0]))
        controls.append(control)
    solution = solver.solve(replace(sketch, controls=tuple(controls)))
    assert [key for key in solution.unmet if key.frame < late - 0.3 * truth.fps] == []


def test_a_single_key_gives_a_pose(solver, database):
    solution = solver.solve(Sketch("one", 30.0, (Control("lhand", np.array([7.0]), np.array([[0.3, 1.2, 0.4]])),)))
    assert solution.motion.frames == 1
    assert solution.unmet == ()
    assert_sound(solution, database)


def test_keys_of_feet_in_a_single_frame_give_a_pose_that_stands(truth, solver, database):
    bones = truth.skeleton
    places, _ = forward_kinematics(bones, standing(bones)[None], np.zeros((1, 3)))
    places[..., 1] -= places[..., 1].min()
    keyed = [Control(name, np.array([1.0]), places[:, bones.index(name)]) for name in ("root", "lfoot", "rfoot")]
    solution = solver.solve(Sketch("stance", 24.0, tuple(keyed)))
    assert solution.motion.frames == 1
    assert solution.unmet == ()
    assert_sound(solution, database)


def test_follow_leads_from_the_databases_motion_to_the_curve(truth, solver, walk):
    hand = truth.skeleton.index("rhand")
    control = next(control for control in walk.controls if control.joint == "rhand")

    def away(follow):
        positions = positions_of(solver.solve(walk, SketchSettings(follow=follow)).motion)[:, hand]
        return np.linalg.norm(positions - control.curve(walk.frames), axis=1).mean()

    assert away(1.0) < 0.005 < away(0.0)


def test_behaviours_and_variations_are_drawn_from_other_clips(solver, walk):
    best, next_best = (solver.solve(walk, SketchSettings(variation=number)) for number in (0, 1))
    assert np.abs(best.motion.rotations - next_best.motion.rotations).max() > 0.01
    assert next_best.key_distances_m.max() < LIMITS.met_m
    boxing = solver.solve(walk, SketchSettings(behaviours=("box*",)))
    assert all(name.startswith("boxing") for name in boxing.drawn_from)
    with pytest.raises(SettingsError, match="no clip has the behaviour swim; choose from boxing"):
        solver.solve(walk, SketchSettings(behaviours=("swim",)))


@pytest.mark.parametrize("wrong", [{"follow": 1.5}, {"follow": float("nan")}, {"variation": -1}])
def test_settings_out_of_range_are_refused(wrong):
    with pytest.raises(SettingsError, match=r"must be a (number from 0 to 1|whole number of at least 0)"):
        SketchSettings(**wrong)


def test_frames_may_be_counted_from_anywhere(truth, solver, walk):
    later = replace(walk, controls=tuple(replace(control, frames=control.frames + 1000.0) for control in walk.controls))
    motions = [solver.solve(sketch).motion for sketch in (walk, later)]
    np.testing.assert_allclose(motions[0].rotations, motions[1].rotations, atol=1e-9)


@pytest.mark.parametrize("way", [(0.0, 3.0, 0.0), (-3.0, 0.0, 0.0), (0.0, 0.0, 3.0), (0.0, -3.0, 0.0)])
def test_a_hand_three_metres_from_the_hips_is_stretched_out_to_its_key(truth, solver, walk, database, way):
    hips = walk.controls[0].positions_m[2]

    def away(positions):
        result = positions.copy()
        result[2] = hips + way
        return result

    solution = solver.solve(changed(walk, "rhand", away))
    assert {key.frame for key in solution.unmet} == {32}
    worst, *others = sorted(solution.unmet, key=lambda key: -key.distance_m)
    reach_m = Reach(truth.skeleton, ("root", "rhand")).between("root", "rhand")
    assert worst.joint == "rhand"
    assert worst.distance_m < 3.0 - reach_m + 0.2
    assert worst.reason == f"it is 3.00 m from root, but the body reaches only {reach_m:.2f} m"
    assert max((key.distance_m for key in others), default=0.0) < 0.1
    assert_sound(solution, database)


def test_exchanged_feet_wring_nothing(solver, walk, database):
    other = {"lfoot": "rfoot", "rfoot": "lfoot"}
    controls = [replace(control, joint=other.get(control.joint, control.joint)) for control in walk.controls]
    solution = solver.solve(replace(walk, controls=tuple(controls)))
    assert_sound(solution, database)
    assert max((key.distance_m for key in solution.unmet), default=0.0) < 0.05


def test_two_keys_in_one_frame_are_met_half_way_and_told(solver, walk, database):
    def doubled(control):
        frames, positions = control.frames, control.positions_m
        apart = positions[2] + [0.1, 0.0, 0.0]
        return replace(
            control, frames=np.insert(frames, 3, frames[2]), positions_m=np.insert(positions, 3, apart, axis=0)
        )

    controls = [doubled(control) if control.joint == "lhand" else control for control in walk.controls]
    solution = solver.solve(replace(walk, controls=tuple(controls)))
    assert [(key.joint, key.frame) for key in solution.unmet] == [("lhand", 32), ("lhand", 32)]
    assert [key.distance_m for key in solution.unmet] == pytest.approx([0.05, 0.05], abs=0.005)
    assert {key.reason for key in solution.unmet} == {"this control has several keys in this frame"}
    assert_sound(solution, database)


def test_a_body_may_lie_although_no_clip_does(truth, solver, database):
    skeleton = truth.skeleton
    rotations = standing(skeleton)
    rotations[0] = rot.from_rotation_vector(np.array([-np.pi / 2.0, 0.0, 0.0]))
    positions = forward_kinematics(skeleton, rotations, np.array([0.0, 0.12, 0.0]))[0]
    frames = np.array([0.0, 30.0, 60.0])
    places = [np.repeat(positions[[skeleton.index(name)]], 3, axis=0) for name in FIVE]
    lying = Sketch("lying", 30.0, tuple(Control(name, frames, at) for name, at in zip(FIVE, places, strict=True)))
    solution = solver.solve(lying)
    assert_sound(solution, database)
    assert max((key.distance_m for key in solution.unmet), default=0.0) < 0.05
    assert positions_of(solution.motion)[:, skeleton.index("head"), 1].max() < 0.5


def test_a_moved_key_is_solved_again_as_from_the_start(truth, database, walk):
    moved = changed(walk, "lhand", lambda positions: positions + 0.05 * (np.arange(len(positions)) == 2)[:, None])
    kept = SketchSolver(truth.skeleton, database)
    before = kept.solve(walk)
    picture, last = (kept.preview(moved, SketchSettings(), frame) for frame in (32.0, walk.frames[-1]))
    again = kept.solve(moved)
    fresh = SketchSolver(truth.skeleton, database).solve(moved)
    hand = next(control for control in moved.controls if control.joint == "lhand")
    at = truth.skeleton.index("lhand")
    assert np.linalg.norm(positions_of(picture)[0, at] - hand.positions_m[2]) < LIMITS.met_m
    np.testing.assert_allclose(last.rotations[0], before.motion.rotations[-1], atol=1e-9)
    for name in ("rotations", "root_positions_m"):
        np.testing.assert_allclose(getattr(again.motion, name), getattr(fresh.motion, name), atol=0.02)


@pytest.mark.long
def test_small_edits_do_not_add_up(truth, database, walk):
    """Edits too small to be solved again, thirty of them, are three millimetres."""
    kept = SketchSolver(truth.skeleton, database)
    kept.solve(walk)
    for _ in range(30):
        walk = changed(walk, "lhand", lambda positions: positions + np.array([0.0, 0.00009, 0.0]))
        solution = kept.solve(walk)
    assert solution.key_distances_m.max() < 0.002


def test_a_first_picture_needs_a_last_solution(truth, database, walk):
    assert SketchSolver(truth.skeleton, database).preview(walk, SketchSettings(), 0.0) is None


def test_clips_that_are_too_short_are_told(truth, database_of, tmp_path, walk):
    short = database_of(tmp_path / "short.pfdb", [sliced(truth, 0, 8), sliced(truth, 20, 28)])
    with pytest.raises(DatabaseError, match=r"has no usable clip of at least \d\.\d s"):
        SketchSolver(truth.skeleton, short).solve(walk)
