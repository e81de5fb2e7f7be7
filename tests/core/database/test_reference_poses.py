"""Reference poses of made subjects, who differ by known rests of hands and by what they perform."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from bench.subset import write_database, write_subset
from perfanim.core.body.standard_skeleton import JOINT_NAMES, default_skeleton, scaled
from perfanim.core.database.reference_poses import find_reference_poses, reference_pose_report, relative_poses
from perfanim.core.database.store import Clip, Database, open_database
from perfanim.core.geometry import rotations as rot

HAND, ELBOW, OTHER = (JOINT_NAMES.index(name) for name in ("rhand", "lradius", "lhand"))
SUBJECTS, CLIPS, FRAMES = 6, 5, 40
BEND_RAD, FRAME_RAD, CLIP_RAD = 0.5, 0.1, 0.05


@pytest.fixture(scope="module")
def rests() -> np.ndarray:
    """(S, 3) rests of the right hand, rotation vectors."""
    return np.random.default_rng(1).normal(scale=BEND_RAD, size=(SUBJECTS, 3))


@pytest.fixture(scope="module")
def motion(rests: np.ndarray) -> tuple[np.ndarray, list[Clip]]:
    """Rotations with those rests; the left hand differs from clip to clip, the elbow from one to the other."""
    generator = np.random.default_rng(2)
    count = SUBJECTS * CLIPS * FRAMES
    vectors = generator.normal(scale=FRAME_RAD, size=(count, len(JOINT_NAMES), 3))
    clips = []
    for number in range(SUBJECTS * CLIPS):
        subject, part = number // CLIPS, slice(number * FRAMES, (number + 1) * FRAMES)
        vectors[part] += generator.normal(scale=CLIP_RAD, size=(len(JOINT_NAMES), 3))
        vectors[part, HAND] += rests[subject]
        vectors[part, ELBOW] += rests[subject]
        vectors[part, OTHER] += generator.normal(scale=BEND_RAD / 2.0, size=3)
        clips.append(Clip(f"{number}.bvh", "", f"{subject}", 60.0, part.start, part.stop, subject))
    return rot.from_rotation_vector(vectors), clips


@pytest.fixture(scope="module")
def database(motion: tuple[np.ndarray, list[Clip]], tmp_path_factory: pytest.TempPathFactory) -> Database:
    rotations, clips = motion
    skeletons = [scaled(default_skeleton(), 1.0 + 0.02 * subject) for subject in range(SUBJECTS)]
    path = tmp_path_factory.mktemp("reference_poses") / "m.pfdb"
    write_database(path, 60.0, rotations, np.zeros((len(rotations), 3)), clips, skeletons)
    return open_database(path)


def turn_deg(pose: np.ndarray, other: np.ndarray, joint: int) -> float:
    return float(np.degrees(rot.angle_between(pose[joint], other[joint])))


def test_rests_of_hands_are_found(database: Database, rests: np.ndarray) -> None:
    # the median of a clip is off by its own share, five clips average it; what is drawn to the middle is little of it
    noise_deg = np.degrees(3.0 * np.sqrt(3.0 * 2.0 * CLIP_RAD**2 / CLIPS))
    for (one, first), (other, second) in pairwise(zip(database.reference_poses, rests, strict=True)):
        wanted = rot.angle_between(rot.from_rotation_vector(first), rot.from_rotation_vector(second))
        found = turn_deg(one.rotations, other.rotations, HAND)
        assert abs(found - np.degrees(wanted)) < noise_deg, (one.subject, other.subject)


def test_differences_between_clips_do_not_change_the_reference_pose(database: Database) -> None:
    report = reference_pose_report(database)
    by_joint = {joint: [turns[joint] for turns in report.values()] for joint in ("rhand", "lhand", "lthumb")}
    assert len(by_joint["rhand"]) == SUBJECTS
    # a subject's mean of five clips is off by this; drawn to the middle it is less
    assert np.mean(by_joint["lhand"]) < np.degrees(np.sqrt(3.0 / CLIPS) * BEND_RAD / 2.0)
    assert max(by_joint["lthumb"]) < np.degrees(2.0 * CLIP_RAD)
    assert max(by_joint["rhand"]) > np.degrees(BEND_RAD)


def test_flipped_hands_keep_the_last_rotation_that_is_possible(motion: tuple[np.ndarray, list[Clip]]) -> None:
    rotations, clips = motion
    turn = rot.from_rotation_vector(np.array([np.pi, 0.0, 0.0]))
    flipped = rotations.copy()
    flipped[10:14, HAND] = rot.multiply(flipped[10:14, HAND], turn)
    flipped[FRAMES : FRAMES + 3, HAND] = rot.multiply(flipped[FRAMES : FRAMES + 3, HAND], turn)
    poses = relative_poses(flipped, clips)[2][:, HAND - 1]
    np.testing.assert_array_equal(poses[10:14], np.repeat(poses[9:10], 4, axis=0))
    np.testing.assert_array_equal(poses[FRAMES : FRAMES + 3], np.repeat(poses[FRAMES + 3 : FRAMES + 4], 3, axis=0))
    assert np.all(np.diff(poses[14:FRAMES], axis=0).any(axis=1))


def test_limbs_that_markers_show_keep_the_common_reference_pose(database: Database) -> None:
    turns = [turn_deg(reference.rotations, database.mean_rotations, ELBOW) for reference in database.reference_poses]
    np.testing.assert_allclose(turns, 0.0, atol=1e-5)


def test_the_recorded_motion_comes_back(database: Database, motion: tuple[np.ndarray, list[Clip]]) -> None:
    # float32 rotation vectors: 1e-7 rad each
    assert rot.angle_between(database.local_rotations(slice(None)), motion[0]).max() < 1e-6
    some = np.array([3, 250, 1100])
    assert rot.angle_between(database.local_rotations(some), motion[0][some]).max() < 1e-6


def test_equal_hands_have_equal_numbers(database: Database, rests: np.ndarray) -> None:
    spread = database.poses[:, HAND - 1].astype(float).std(axis=0)
    assert (
        np.linalg.norm(spread) < 2.0 * np.sqrt(3.0) * np.hypot(FRAME_RAD, CLIP_RAD) < np.linalg.norm(rests.std(axis=0))
    )


def test_a_recorded_body_has_its_own_reference_pose_and_a_stranger_the_common_one(database: Database) -> None:
    assert database.reference_pose_of(scaled(default_skeleton(), 1.04)) is database.reference_poses[2].rotations
    assert database.reference_pose_of(scaled(default_skeleton(), 1.05)) is database.mean_rotations


def test_a_recorded_subject_with_measured_bones_is_found_by_name(database: Database) -> None:
    measured, person = scaled(default_skeleton(), 1.05), database.reference_poses[2]
    assert database.reference_pose_of(measured, person.subject) is person.rotations
    assert database.reference_pose_of(measured, "nobody") is database.mean_rotations


def test_own_frames_are_those_of_equal_bones_or_of_the_name(database: Database) -> None:
    of_third = np.repeat([clip.subject == "2" for clip in database.clips], FRAMES)
    np.testing.assert_array_equal(database.own_frames(scaled(default_skeleton(), 1.04)), of_third)
    stranger = scaled(default_skeleton(), 1.05)
    np.testing.assert_array_equal(database.own_frames(stranger, "2"), of_third)
    assert not database.own_frames(stranger).any()
    assert not database.own_frames(stranger, "nobody").any()


def test_mirror_images_have_reference_poses_of_their_own(motion: tuple[np.ndarray, list[Clip]]) -> None:
    rotations, clips = motion
    images = [Clip(c.name, "", c.subject, 60.0, c.start, c.stop, c.skeleton, mirrored=True) for c in clips[:CLIPS]]
    shifted = [
        Clip(c.name, "", c.subject, 60.0, c.start + len(rotations), c.stop + len(rotations), c.skeleton, mirrored=True)
        for c in images
    ]
    both = np.concatenate((rotations, rotations[: CLIPS * FRAMES]))
    _, references = find_reference_poses(both, [*clips, *shifted])
    assert [(reference.subject, reference.mirrored) for reference in references][-1] == ("0", True)
    assert len(references) == SUBJECTS + 1


@pytest.mark.parametrize("clips", [2 * CLIPS, 1])
def test_too_few_subjects_have_the_common_reference_pose(motion: tuple[np.ndarray, list[Clip]], clips: int) -> None:
    rotations, all_clips = motion
    mean, references, poses = relative_poses(rotations[: clips * FRAMES], all_clips[:clips])
    assert references == ()
    back = rot.multiply(mean[1:], rot.from_rotation_vector(poses.astype(float)))
    assert rot.angle_between(back, rotations[: clips * FRAMES, 1:]).max() < 1e-6


def test_a_subset_finds_reference_poses_of_its_own(database: Database, tmp_path: Path) -> None:
    kept = [(clip, 0, FRAMES) for clip in database.clips if clip.subject != "5"]
    part = write_subset(database, tmp_path / "part.pfdb", kept)
    assert [reference.subject for reference in part.reference_poses] == ["0", "1", "2", "3", "4"]
    frames = len(kept) * FRAMES
    turns = rot.angle_between(part.local_rotations(slice(None)), database.local_rotations(slice(0, frames)))
    assert turns.max() < 2e-6  # twice float32
