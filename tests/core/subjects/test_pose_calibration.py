import numpy as np
import pytest
from motion_synthesis.bodies import body
from perfanim.core.body.calibration_poses import CALIBRATION, POSES, motorcycle, standing, t_pose
from perfanim.core.body.motion import Motion
from perfanim.core.body.skeleton import marker_positions
from perfanim.core.errors import PerfanimError, SubjectError
from perfanim.core.geometry import rotations as rot
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.markers.marker_set import Marker, MarkerSet, load_marker_set
from perfanim.core.markers.marker_take import MarkerTake
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.simulate.studio.stage_placement import with_poses
from perfanim.core.subjects.from_recording import subject_from_recording
from perfanim.core.subjects.pose_calibration import (
    calibrate_markers,
    calibrate_subject,
    calibration_points,
    pose_points,
)
from perfanim.core.subjects.prototype_bodies import load_bodies
from perfanim.core.system.assets import SKELETONS

PROTOTYPES = load_bodies(SKELETONS)
BOXING = load_marker_set("boxing")
NOISE_M = 0.002
# people of one height differ in the share of a segment by up to 3.5 % (one standard deviation, neck and shoulders)
SEGMENT_SPREAD = 0.035
LIMBS = {"leg": ("femur", "tibia"), "arm": ("humerus", "radius")}
PEOPLE = [(1.55, -0.5, 901), (1.68, 0.5, 902), (1.75, 0.0, 903), (1.83, -0.8, 904), (1.95, 0.8, 905)]


def markers_of(skeleton, pose=t_pose, marker_set=BOXING, yaw=0.3, place=(0.4, 0.95, -2.5)):
    rotations = pose(skeleton)
    rotations[0] = rot.from_rotation_vector([0.0, yaw, 0.0])
    joints = marker_set.joint_indices(skeleton)
    return marker_positions(skeleton, joints, marker_set.offsets_m, rotations, np.array(place))


def limb_lengths(skeleton):
    return {
        side + limb: sum(np.linalg.norm(skeleton.tips_m[skeleton.index(side + bone)]) for bone in bones)
        for side in "lr"
        for limb, bones in LIMBS.items()
    }


@pytest.mark.parametrize(("height", "build", "seed"), PEOPLE)
@pytest.mark.parametrize("pose", ["t", "standing"])
def test_bones_of_people_who_are_no_prototype(height, build, seed, pose):
    person = body(height, build, seed)
    points = markers_of(person, {"t": t_pose, "standing": standing}[pose])
    points = points + np.random.default_rng(seed).normal(scale=NOISE_M, size=points.shape)
    result = calibrate_subject(points, BOXING, PROTOTYPES, "Ann", pose)
    found, true = limb_lengths(result.subject.skeleton), limb_lengths(person)
    for limb, length in true.items():
        # two standard deviations of how people differ, in that limb and where it begins
        assert found[limb] == pytest.approx(length, rel=2.0 * np.sqrt(2.0) * SEGMENT_SPREAD), limb
    assert result.subject.skeleton.names == person.names
    assert result.subject.marker_set.names == BOXING.names
    assert result.subject.residual_m < 0.03


def test_limbs_are_better_known_than_by_a_person_of_usual_size():
    own, usual = [], []
    middle = limb_lengths(PROTOTYPES[len(PROTOTYPES) // 2])
    for height, build, seed in PEOPLE:
        person = body(height, build, seed)
        found = limb_lengths(calibrate_subject(markers_of(person), BOXING, PROTOTYPES, "a").subject.skeleton)
        true = limb_lengths(person)
        own += [abs(found[limb] - true[limb]) for limb in true]
        usual += [abs(middle[limb] - true[limb]) for limb in true]
    assert np.mean(own) < 0.5 * np.mean(usual)


def test_offsets_put_the_markers_where_they_were_seen():
    """Worn 2 cm from the usual places: the subject in the calibration pose shows exactly what was seen."""
    person = body(1.8, 0.2, 910)
    worn = BOXING.with_offsets(BOXING.offsets_m + np.random.default_rng(0).normal(scale=0.02, size=(9, 3)))
    points = markers_of(person, marker_set=worn, yaw=0.0)
    subject = calibrate_subject(points, BOXING, PROTOTYPES, "a").subject
    assert subject.marker_set.names == BOXING.names
    # offsets were measured in a pose found for the seen markers: a few degrees and centimetres off the true ones
    assert np.linalg.norm(subject.marker_set.offsets_m - worn.offsets_m, axis=1).max() < 0.08
    shown = markers_of(subject.skeleton, marker_set=subject.marker_set, yaw=0.0, place=(0.0, 0.0, 0.0))
    torso = BOXING.torso
    between = np.linalg.norm(shown[torso][:, None] - shown[torso][None], axis=2)
    seen = np.linalg.norm(points[torso][:, None] - points[torso][None], axis=2)
    np.testing.assert_allclose(between, seen, atol=1e-6)


def test_a_pose_that_is_not_held_exactly_is_borne():
    """Arms 15 degrees too low: bones come out as with level arms."""
    person = body(1.75, 0.0, 911)

    def sagging(skeleton):
        rotations = t_pose(skeleton)
        for side, sign in (("l", -1.0), ("r", 1.0)):
            rotations[skeleton.index(f"{side}humerus")] = rot.from_rotation_vector([0.0, 0.0, sign * np.radians(15)])
        return rotations

    exact = limb_lengths(calibrate_subject(markers_of(person), BOXING, PROTOTYPES, "a").subject.skeleton)
    low = limb_lengths(calibrate_subject(markers_of(person, sagging), BOXING, PROTOTYPES, "a").subject.skeleton)
    for limb, length in exact.items():
        assert low[limb] == pytest.approx(length, rel=0.05)


def test_sides_are_measured_apart():
    """A left arm that is 3 cm longer comes out longer than the right one."""
    points = markers_of(PROTOTYPES[12], yaw=0.0)
    points[BOXING.names.index("LHAN"), 0] += 0.03
    found = limb_lengths(calibrate_subject(points, BOXING, PROTOTYPES, "a").subject.skeleton)
    assert 0.005 < found["larm"] - found["rarm"] < 0.03


def test_a_set_without_usual_offsets():
    """Markers right on joints, as takes of other programs have them."""
    joints = ("lhumerus", "rhumerus", "lfemur", "rfemur", "lradius", "rradius", "lhand", "rhand", "lfoot", "rfoot")
    marker_set = MarkerSet("joints", tuple(Marker(j, j, None, i < 4) for i, j in enumerate(joints)))
    person = body(1.7, 0.0, 912)
    points = markers_of(person, marker_set=marker_set.with_offsets(np.zeros((10, 3))))
    subject = calibrate_subject(points, marker_set, PROTOTYPES, "a").subject
    for limb, length in limb_lengths(person).items():
        assert limb_lengths(subject.skeleton)[limb] == pytest.approx(length, rel=2.0 * np.sqrt(2.0) * SEGMENT_SPREAD)


def test_refusals():
    points = markers_of(PROTOTYPES[3])
    with pytest.raises(SubjectError, match="no calibration pose 'yoga'; choose from t, standing"):
        calibrate_subject(points, BOXING, PROTOTYPES, "Ann", "yoga")
    hand_unseen = points.copy()
    hand_unseen[BOXING.names.index("LHAN")] = np.nan
    with pytest.raises(SubjectError, match="Ann: no frame shows LHAN; record the pose again"):
        calibrate_subject(hand_unseen, BOXING, PROTOTYPES, "Ann")
    torso_unseen = points.copy()
    torso_unseen[[BOXING.names.index(name) for name in ("LSHO", "RWAI")]] = np.nan
    with pytest.raises(SubjectError, match=r"Ann: fewer than three torso markers were visible \(hidden: LSHO, RWAI\)"):
        calibrate_subject(torso_unseen, BOXING, PROTOTYPES, "Ann")


def held_take(seconds=(1.0, 1.5, 1.0), fps=30.0):
    """A take in which the performer walks in, holds the pose, and walks out; one marker is missing half of the time."""
    held = markers_of(PROTOTYPES[10])
    frames = [round(s * fps) for s in seconds]
    path = np.concatenate((np.linspace(-1.5, 0.0, frames[0]), np.zeros(frames[1]), np.linspace(0.0, 1.5, frames[2])))
    positions = held[None] + path[:, None, None] * np.array([1.0, 0.0, 0.0])
    positions += np.random.default_rng(0).normal(scale=NOISE_M, size=positions.shape)
    positions[::2, 4] = np.nan
    return MarkerTake("calib", fps, BOXING.names, positions), held


def test_the_still_second_is_found():
    take, held = held_take()
    points = calibration_points(take, BOXING)
    # the median of some twenty noisy positions: 1.25 s / sqrt(n), five of them
    np.testing.assert_allclose(points, held, atol=5.0 * 1.25 * NOISE_M / np.sqrt(15))


def test_a_window_of_the_take_can_be_chosen():
    take, held = held_take()
    with pytest.raises(SubjectError, match=r"never still for 0\.3 s"):  # the walk up to the place
        calibration_points(take, BOXING, 0.3, slice(0, 20))
    assert np.abs(calibration_points(take, BOXING, 0.3, slice(20, None)) - held).max() < 5.0 * NOISE_M
    with pytest.raises(SubjectError, match="fewer than three markers are seen at once"):
        calibration_points(take, BOXING, 1.0, slice(50, 50))


def test_takes_that_do_not_show_it_are_refused():
    take, _ = held_take()
    other = MarkerTake("other", 30.0, ("A", "B", "C"), np.zeros((5, 3, 3)))
    with pytest.raises(SubjectError, match=r"other: the take has no marker HEAD, .*its markers are A, B, C"):
        calibration_points(other, BOXING)
    hardly = MarkerTake("t", 30.0, take.names, np.where(np.arange(9)[:, None] < 2, take.positions_m, np.nan))
    with pytest.raises(SubjectError, match="fewer than three markers are seen"):
        calibration_points(hardly, BOXING)


def frames_of(points, count=10, seed=0):
    """Marker frames with the points in any order, a ghost, and noise."""
    rng = np.random.default_rng(seed)
    result = []
    for number in range(count):
        seen = points + rng.normal(scale=NOISE_M, size=points.shape)
        everything = np.concatenate((seen, rng.uniform([-2.0, 0.0, -5.0], [2.0, 2.0, -4.0], (1, 3))))
        everything = everything[rng.permutation(len(everything))]
        result.append(
            MarkerFrame(number, number / 30.0, everything, np.tile(1e-6 * np.eye(3), (len(everything), 1, 1)))
        )
    return result


def test_a_subject_from_unlabelled_frames_of_one_pose():
    person = body(1.72, 0.3, 920)
    points = markers_of(person)
    found = subject_from_recording(frames_of(points, 45), 30.0, BOXING, PROTOTYPES, "Ann", ("t",))
    expected = calibrate_subject(points, BOXING, PROTOTYPES, "Ann")
    assert found.subject.name == "Ann"
    lengths = [np.linalg.norm(each.subject.skeleton.tips_m, axis=1) for each in (found, expected)]
    np.testing.assert_allclose(*lengths, atol=5.0 * NOISE_M)
    offsets = found.subject.marker_set.offsets_m
    np.testing.assert_allclose(offsets, expected.subject.marker_set.offsets_m, atol=10.0 * NOISE_M)


def test_frames_that_do_not_show_the_pose_are_refused():
    points = markers_of(PROTOTYPES[8])
    few = [MarkerFrame(i, i / 30, f.points_m[:4], f.covariances_m2[:4]) for i, f in enumerate(frames_of(points, 45))]
    with pytest.raises(PerfanimError, match="no frame shows more than 4 of 9 markers"):
        subject_from_recording(few, 30.0, BOXING, PROTOTYPES, "Ann", ("t",))
    with pytest.raises(PerfanimError, match="no frame shows more than 0 of 9 markers"):
        subject_from_recording([], 30.0, BOXING, PROTOTYPES, "Ann", ("t",))


@pytest.mark.long
def test_a_hand_that_waves_makes_no_held_pose():
    points_m = np.tile(markers_of(PROTOTYPES[8]), (45, 1, 1))
    points_m[:, BOXING.names.index("LHAN"), 1] += 0.15 * np.sin(0.3 * np.arange(45))
    points_m += np.random.default_rng(0).normal(scale=NOISE_M, size=points_m.shape)
    with pytest.raises(SubjectError, match=r"never still for 1\.0 s"):
        pose_points(MarkerTake("wave", 30.0, BOXING.names, points_m), BOXING, ("t",))


def test_hanging_arms_are_no_t_pose():
    points = markers_of(body(1.75, 0.0, 903), standing)
    with pytest.raises(SubjectError, match=r"arm is .* degrees away"):
        calibrate_subject(points, BOXING, PROTOTYPES, "Ann", "t")


def test_a_take_that_never_stands_still_has_no_calibration_pose(true_markers, subject):
    take = MarkerTake("walk", 30.0, subject.marker_set.names, true_markers[30:])
    with pytest.raises(SubjectError, match="never still"):
        calibration_points(take, subject.marker_set)


@pytest.mark.parametrize(("before", "after"), [("locomotion", "boxing"), ("boxing", "locomotion"), ("boxing", "kendo")])
def test_other_markers_need_no_other_skeleton(before, after):
    """Markers added, taken off and exchanged: bones stay, and markers that stay are found where they were."""
    person, generator = body(1.72, 0.4, 912), np.random.default_rng(3)
    first, second = load_marker_set(before), load_marker_set(after)
    known = calibrate_subject(markers_of(person, marker_set=first), first, PROTOTYPES, "Ann").subject
    points = markers_of(person, marker_set=second, yaw=-0.4, place=(0.0, 0.95, -3.0))
    points = points + generator.normal(scale=NOISE_M, size=points.shape)
    subject = calibrate_markers(points, second, known, "Ann").subject
    np.testing.assert_array_equal(subject.skeleton.offsets_m, known.skeleton.offsets_m)
    assert subject.marker_set.names == second.names
    old = dict(zip(known.marker_set.names, known.marker_set.offsets_m, strict=True))
    for marker, offset in zip(subject.marker_set.names, subject.marker_set.offsets_m, strict=True):
        if marker in old:
            # noise of the marker, and of the four of the torso and those of the limb that place the body
            assert np.linalg.norm(offset - old[marker]) < 5.0 * np.sqrt(3.0) * NOISE_M, marker
    assert subject.residual_m < 0.03


def carelessly(pose, rng, trunk):
    """The pose with every angle of the limbs, and with `trunk` of trunk and collar bones, off by up to 10 degrees."""

    def taken(skeleton):
        rotations = pose(skeleton)
        for side, outward in (("l", 1.0), ("r", -1.0)):
            for joint in ("humerus", "femur", "hand", *(("clavicle",) if trunk else ())):
                off = rot.from_rotation_vector(np.radians(rng.uniform(-10.0, 10.0, 3) / np.sqrt(3.0)))
                place = skeleton.index(side + joint)
                rotations[place] = rot.multiply(off, rotations[place])
            # elbows and knees do not bend backwards
            for joint, axis in (("radius", [0.0, -outward, 0.0]), ("tibia", [1.0, 0.0, 0.0])):
                place = skeleton.index(side + joint)
                bent = rot.from_rotation_vector(np.radians(rng.uniform(0.0, 10.0)) * np.array(axis))
                rotations[place] = rot.multiply(rotations[place], bent)
        if trunk:
            for joint in ("lowerback", "upperback", "thorax"):
                off = rng.uniform(-10.0, 10.0, 3) / np.sqrt(3.0) / 3.0
                rotations[skeleton.index(joint)] = rot.from_rotation_vector(np.radians(off))
        return rotations

    return taken


def errors_with(poses):
    """Errors of joints' distances from their parents, and the standard deviations that are told, (P, J) metres."""
    errors, sigmas = [], []
    for height, build, seed in PEOPLE:
        person, rng = body(height, build, seed), np.random.default_rng(seed)
        worn = BOXING.with_offsets(BOXING.offsets_m + rng.normal(scale=0.005, size=(9, 3)))
        points = np.array(
            [
                markers_of(person, carelessly(POSES[pose], rng, i > 0), worn) + rng.normal(scale=0.001, size=(9, 3))
                for i, pose in enumerate(poses)
            ]
        )
        found = calibrate_subject(points, BOXING, PROTOTYPES, "a", *poses)
        lengths = [np.linalg.norm(s.offsets_m, axis=1) for s in (found.subject.skeleton, person)]
        errors.append(lengths[0] - lengths[1])
        sigmas.append([found.sigmas_m[name] for name in person.names])
    return np.array(errors), np.array(sigmas)


def test_poses_with_stretched_arms_tell_shoulders_from_arms():
    index = PROTOTYPES[0].index
    parts = [[index(side + joint) for side in "lr"] for joint in ("humerus", "radius", "wrist")]
    one, one_sigma = errors_with(("t",))
    three, three_sigma = errors_with(CALIBRATION)
    shoulders = parts[0]
    # a T pose has only the sum of shoulder and arm; arms in two more directions fix where they begin
    assert np.sqrt(np.mean(three[:, shoulders] ** 2)) < 0.7 * np.sqrt(np.mean(one[:, shoulders] ** 2))
    assert three_sigma[:, shoulders].max() < 0.6 * one_sigma[:, shoulders].min()
    for errors, sigmas in ((one, one_sigma), (three, three_sigma)):
        for part in parts:  # of ten values none is further off than three times what is told
            assert np.all(np.abs(errors[:, part]) < 3.0 * sigmas[:, part])


def test_what_would_make_it_better_is_told():
    person = body(1.75, 0.0, 903)
    one = calibrate_subject(markers_of(person), BOXING, PROTOTYPES, "a")
    assert one.verdict == "usable"
    assert "hold these poses as well: the pose with hanging arms, the motorcycle pose" in one.advice[0]
    points = np.array([markers_of(person, pose) for pose in map(POSES.__getitem__, CALIBRATION)])
    assert calibrate_subject(points, BOXING, PROTOTYPES, "a", *CALIBRATION).verdict == "good"
    points[:, BOXING.names.index("HEAD")] += [0.0, 0.1, 0.0]  # worn on a hat
    hat = calibrate_subject(points, BOXING, PROTOTYPES, "a", *CALIBRATION)
    assert hat.marker_residuals_m["HEAD"] == max(hat.marker_residuals_m.values())
    assert any("marker of the head is" in text and "from its usual position" in text for text in hat.advice)


def test_a_marker_hidden_in_one_of_the_poses_is_found_in_another():
    person = body(1.75, 0.0, 903)
    points = np.array([markers_of(person, pose) for pose in map(POSES.__getitem__, CALIBRATION)])
    whole = calibrate_subject(points, BOXING, PROTOTYPES, "a", *CALIBRATION).subject
    points[1, BOXING.names.index("LHAN")] = np.nan
    result = calibrate_subject(points, BOXING, PROTOTYPES, "a", *CALIBRATION)
    found = result.subject
    assert result.verdict == "usable"
    assert "the marker of the left hand was not seen in the pose with hanging arms" in result.advice[0]
    # one hand in one pose: what it told of the left arm, of the order of what people differ in
    np.testing.assert_allclose(found.skeleton.offsets_m, whole.skeleton.offsets_m, atol=SEGMENT_SPREAD * 0.6)
    points[:, BOXING.names.index("LHAN")] = np.nan
    with pytest.raises(SubjectError, match="no frame shows LHAN"):
        calibrate_subject(points, BOXING, PROTOTYPES, "a", *CALIBRATION)


def posing_take(poses, seconds=1.5):
    person = body(1.72, 0.3, 920)
    end = Motion("end", 30.0, person, standing(person)[None], np.array([[0.0, 0.95, 0.0]]))
    motion = with_poses(end, poses, seconds)
    return person, simulate_markers(motion, BOXING, noise_mm=1.0)[0]


def test_each_pose_is_found_in_the_take_by_itself():
    person, take = posing_take(("motorcycle", "t", "standing"))
    points = pose_points(take, BOXING, ("t", "motorcycle"))
    for found, pose in zip(points, (t_pose, motorcycle), strict=True):
        seen = found - found.mean(axis=0)
        true = markers_of(person, pose, yaw=0.0)
        # medians of 30 values with 1 mm of noise: 1.25 mm / sqrt(30), five of them
        np.testing.assert_allclose(seen, true - true.mean(axis=0), atol=5.0 * 1.25e-3 / np.sqrt(30.0))
    _, short = posing_take(("t",))
    with pytest.raises(SubjectError, match=r"the motorcycle pose is not held for 1\.0 s"):
        pose_points(short, BOXING, ("t", "motorcycle"))
    for poses, words in ((("t", "yoga"), "no calibration pose 'yoga'"), (("t", "t"), "is named twice")):
        with pytest.raises(SubjectError, match=words):
            pose_points(take, BOXING, poses)


@pytest.mark.long
def test_a_subject_from_unlabelled_frames_of_several_poses():
    _, take = posing_take(CALIBRATION)
    rng = np.random.default_rng(2)
    frames = [
        MarkerFrame(i, i / 30.0, row[rng.permutation(9)], np.tile(1e-6 * np.eye(3), (9, 1, 1)))
        for i, row in enumerate(take.positions_m)
    ]
    found = subject_from_recording(frames, 30.0, BOXING, PROTOTYPES, "Ann", CALIBRATION)
    expected = calibrate_subject(pose_points(take, BOXING, CALIBRATION), BOXING, PROTOTYPES, "Ann", *CALIBRATION)
    np.testing.assert_allclose(found.subject.skeleton.offsets_m, expected.subject.skeleton.offsets_m, atol=1e-9)
