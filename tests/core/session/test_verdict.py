"""Verdicts on motions that somebody would accept or refuse at a glance."""

from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.body.body_size import standing_root_m, stature_m
from perfanim.core.body.calibration_poses import standing
from perfanim.core.body.motion import Motion
from perfanim.core.body.scene_pose import PerformerPose
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.geometry import rotations as rot
from perfanim.core.markers.marker_set import PointKind, load_marker_set
from perfanim.core.markers.subject import Subject
from perfanim.core.session.verdict import ReasonKind, judge

FPS, FRAMES = 50.0, 200
SET = load_marker_set("cmu-41")
BODY = default_skeleton()
WEARER = Subject("wearer", BODY, SET)
ROOT, UP = standing_root_m(BODY), np.array([0.0, 1.0, 0.0])


def posed(root_turn=(0.0, 0.0, 0.0), place=ROOT, hips=(0.0, 0.0, 0.0), knees=(0.0, 0.0, 0.0), frames=FRAMES):
    """Return a motion of one pose: standing, its root, thighs and shanks turned by rotation vectors."""
    pose = standing(BODY)
    pose[0] = rot.from_rotation_vector(np.array(root_turn))
    for side in "lr":
        for bone, turn in (("femur", hips), ("tibia", knees)):
            joint = BODY.index(side + bone)
            pose[joint] = rot.multiply(rot.from_rotation_vector(np.array(turn)), pose[joint])
    return Motion("take", FPS, BODY, np.tile(pose, (frames, 1, 1)), np.tile(place, (frames, 1)))


def after(first, second):
    """Return one motion after another."""
    return replace(
        first,
        rotations=np.concatenate((first.rotations, second.rotations)),
        root_positions_m=np.concatenate((first.root_positions_m, second.root_positions_m)),
    )


def poses_of(motion, off=None):
    """Return solved poses with markers that are `off` (F, M, 3) from the body."""
    markers = SET.positions_on(motion.skeleton, motion.rotations, motion.root_positions_m)
    seen = markers if off is None else markers + off
    alone = np.full(len(SET), -1)
    rms = np.sqrt(np.nanmean(np.sum((markers - seen) ** 2, axis=-1), axis=-1))
    rows = zip(motion.rotations, motion.root_positions_m, markers, seen, rms, strict=True)
    return [
        PerformerPose(i, i / FPS, pose, root, 0.9, marker, place, alone, float(error))
        for i, (pose, root, marker, place, error) in enumerate(rows)
    ]


def verdict(motion, off=None, duration_s=None, worn=WEARER, **given):
    duration_s = motion.duration_s if duration_s is None else duration_s
    return judge(motion, poses_of(motion, off), worn, duration_s=duration_s, **given)


def kinds(*given, **named):
    return [reason.kind for reason in verdict(*given, **named).reasons]


def test_a_standing_body_is_good():
    found = verdict(posed())
    assert (found.is_good, found.is_useless, found.text, found.stretches) == (True, False, "good", ())
    assert sum(limb.markers for limb in found.limbs) == len(SET)
    assert {limb.limb for limb in found.limbs} >= {"head", "torso", "left arm", "right leg", "left foot"}
    assert max(limb.distance_95_m for limb in found.limbs) == 0.0
    facts = found.facts()
    assert (facts["verdict"], facts["doubtful"]) == ("good", [])
    assert {row["limb"]: row["distance_mm"] for row in facts["limbs"]}["head"] == 0.0


def test_a_body_that_lies_or_stands_on_its_head_all_the_time():
    low = (0.0, 0.15, 0.0)
    for turn in ((np.pi / 2, 0.0, 0.0), (-np.pi / 2, 0.0, 0.0), (0.0, 0.0, np.pi / 2)):
        (reason,) = verdict(posed(turn, low)).reasons
        assert (reason.kind, "lying down" in reason.text) == (ReasonKind.UPRIGHT, True)
    (reason,) = verdict(posed((np.pi, 0.0, 0.0))).reasons
    assert (reason.kind, "upside down" in reason.text) == (ReasonKind.UPRIGHT, True)


def test_motion_that_is_not_upright_all_the_time_is_good():
    low, lying = (0.0, 0.15, 0.0), (-np.pi / 2, 0.0, 0.0)
    crawl = posed((np.pi / 2, 0.0, 0.0), (0.0, 0.5, 0.0), hips=(-np.pi / 2, 0.0, 0.0), knees=(np.pi / 2, 0.0, 0.0))
    assert verdict(crawl).is_good
    assert verdict(after(posed(lying, low), posed(frames=40))).is_good
    assert verdict(after(posed((np.pi, 0.0, 0.0), (0.0, 1.1, 0.0)), posed(frames=40))).is_good


def test_feet_above_and_below_the_floor():
    for off_m, said in ((1.0, "above"), (-0.4, "below")):
        high = posed(place=ROOT + UP * off_m)
        (reason,) = verdict(high).reasons
        assert (reason.kind, said in reason.text) == (ReasonKind.FLOOR, True)
        assert verdict(high, has_floor=False).is_good
    climbs = np.linspace(0.0, 2.0, FRAMES)[:, None] * UP
    assert verdict(replace(posed(), root_positions_m=ROOT + climbs)).is_good
    assert verdict(posed(place=ROOT + UP * 0.1)).is_good


def test_guessed_legs_say_nothing_about_the_floor():
    above = posed(place=ROOT + 0.5 * UP)
    off = np.zeros((FRAMES, len(SET), 3))
    assert kinds(above, off) == [ReasonKind.FLOOR]
    off[:, [i for i, marker in enumerate(SET.markers) if marker.joint[1:] in ("femur", "tibia", "foot", "toes")]] = (
        np.nan
    )
    assert ReasonKind.FLOOR not in kinds(above, off)


def test_a_body_fitted_far_from_its_markers_is_no_body():
    """Its solved poses may be near the markers all the same, because the joints bend as no joint does."""
    for residual_m, expected in ((0.03, []), (0.06, [ReasonKind.MARKERS])):
        assert kinds(posed(), worn=replace(WEARER, residual_m=residual_m)) == expected
    assert verdict(posed(), worn=replace(WEARER, residual_m=0.06)).is_useless


def test_bones_that_nobody_has():
    small = replace(BODY, offsets_m=0.1 * BODY.offsets_m, tips_m=0.1 * BODY.tips_m)
    assert stature_m(BODY) == pytest.approx(1.72)
    found = verdict(replace(posed(), skeleton=small), has_floor=False)
    assert (found.reasons[0].kind, "0.17 m tall" in found.text) == (ReasonKind.SIZE, True)
    tips, offsets = BODY.tips_m.copy(), BODY.offsets_m.copy()
    tips[BODY.index("lradius")] *= 3.0
    offsets[BODY.index("lwrist")] *= 3.0
    found = verdict(replace(posed(), skeleton=replace(BODY, tips_m=tips, offsets_m=offsets)))
    assert (found.reasons[0].kind, "left forearm" in found.text) == (ReasonKind.SIZE, True)


def test_a_limb_away_from_its_markers():
    off = np.zeros((FRAMES, len(SET), 3))
    arm = [i for i, marker in enumerate(SET.markers) if marker.joint in ("lhumerus", "lradius")]
    off[:, arm] = [0.1, 0.0, 0.0]
    found = verdict(posed(), off)
    assert (found.reasons[0].kind, found.text) == (ReasonKind.LIMB, "left arm is 100 mm from its markers")
    off[:, arm] = [0.06, 0.0, 0.0]  # usual places are that far off, measured ones are not
    assert verdict(posed(), off).is_good
    measured = verdict(posed(), off, worn=replace(WEARER, residual_m=0.004))
    assert measured.text == "left arm is 60 mm from its markers"
    keypoints = replace(SET, points=PointKind.KEYPOINTS)
    assert verdict(posed(), off, worn=Subject("fitted", BODY, keypoints, 0.004)).is_good
    off[:] = np.nan
    off[:, arm] = [0.3, 0.0, 0.0]
    found = verdict(posed(), off)
    assert (found.reasons[0].kind, found.is_useless) == (ReasonKind.MARKERS, True)


def test_a_stretch_away_from_its_markers():
    off = np.zeros((FRAMES, len(SET), 3))
    arm = [i for i, marker in enumerate(SET.markers) if marker.joint in ("lhumerus", "lradius")]
    off[100:105, arm] = [0.2, 0.0, 0.0]
    assert verdict(posed(), off).is_good
    off[100:131, arm] = [0.2, 0.0, 0.0]
    found = verdict(posed(), off)
    (stretch,) = found.stretches
    assert (stretch.first, stretch.last, stretch.part) == (100, 130, "left arm")
    assert (stretch.start_s, stretch.stop_s) == pytest.approx((2.0, 2.6))
    assert (found.reasons[0].kind, found.is_useless) == (ReasonKind.STRETCH, False)
    assert found.text == "left arm is 200 mm from its markers, 2.00 to 2.60 s"


def test_another_duration_than_the_source():
    motion = posed()
    assert kinds(motion, duration_s=motion.duration_s + 0.01) == []
    found = verdict(motion, duration_s=4.6)
    assert (found.reasons[0].kind, found.text) == (ReasonKind.DURATION, "the motion lasts 3.98 s, its take 4.60 s")


def test_frames_without_a_body():
    motion = posed()
    poses = poses_of(motion)
    blank = [replace(pose, confidence=0.0, marker_rms_m=float("nan")) for pose in poses]
    for count, said in ((FRAMES, "no frame"), (FRAMES // 2, "50%")):
        found = judge(motion, [*blank[:count], *poses[count:]], WEARER, duration_s=motion.duration_s)
        assert (found.reasons[0].kind, said in found.text) == (ReasonKind.UNSOLVED, True)
    assert judge(motion, [*blank[:20], *poses[20:]], WEARER, duration_s=motion.duration_s).is_good
