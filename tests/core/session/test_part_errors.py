"""Expected errors of parts of the body, and what people are told."""

from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.body.body_parts import PART_JOINTS, PARTS
from perfanim.core.body.scene_pose import DOUBTFUL_PART_DEG
from perfanim.core.geometry import rotations as rot
from perfanim.core.session.part_errors import PartErrors
from perfanim.core.session.session import Session
from perfanim.core.solver.settings import SolveSettings

LEFT_HAND = 4
KNOWN = np.arange(8)
ARM, HAND = (list(PARTS).index(part) for part in ("left arm", "left hand"))


@pytest.fixture(scope="module")
def noisy(true_markers):
    return true_markers + np.random.default_rng(0).normal(scale=0.002, size=true_markers.shape)


@pytest.fixture(scope="module")
def poses(subject, database, record, noisy):
    """Poses of the walk, whole and without the left hand."""
    without = np.where((KNOWN == LEFT_HAND)[:, None], np.nan, noisy)
    sessions = Session(subject, database), Session(subject, database)
    return [
        [session.step(record(row, number, KNOWN)) for number, row in enumerate(rows)]
        for session, rows in zip(sessions, (noisy, without), strict=True)
    ]


def test_part_errors_are_within_twice_the_expected(poses, truth):
    for performed in poses:
        away = np.degrees(rot.angle_between(np.array([pose.rotations for pose in performed]), truth.rotations))
        found = np.stack([away[:, joints].mean(axis=1) for joints in PART_JOINTS.values()], axis=1)
        expected = np.array([pose.part_errors_deg for pose in performed])
        assert np.mean(found <= 2.0 * expected) > 0.9
        assert np.mean(found <= 0.5 * expected) < 0.9  # no idle threat


def test_joint_errors_are_within_twice_the_expected(poses, truth):
    for performed in poses:
        away = np.degrees(rot.angle_between(np.array([pose.rotations for pose in performed]), truth.rotations))[:, 1:]
        expected = np.array([pose.joint_errors_deg for pose in performed])
        assert expected.shape == away.shape
        assert np.mean(away <= 2.0 * expected) > 0.9
        assert np.mean(away <= 0.5 * expected) < 0.9


def test_a_hidden_hand_makes_its_joints_uncertain_and_no_others(poses, truth):
    whole, without = (np.array([pose.joint_errors_deg for pose in performed]) for performed in poses)
    grown = dict(zip(truth.skeleton.names[1:], np.median(without / whole, axis=0), strict=True))
    assert min(grown["lhumerus"], grown["lradius"]) > 1.3 * max(grown["rradius"], grown["lfemur"], grown["head"])


def test_a_hidden_hand_makes_its_arm_uncertain(poses):
    whole, without = (np.array([pose.part_errors_deg for pose in performed]) for performed in poses)
    grown = np.median(without / whole, axis=0)
    assert int(np.argmax(grown)) == ARM
    assert grown[ARM] > 1.3 * np.delete(grown, [ARM, HAND]).max()


def test_notes_name_uncertain_parts_and_reasons(poses, model):
    errors, told = PartErrors(model), []
    whole, without = (performed[20] for performed in poses)
    arm = DOUBTFUL_PART_DEG + 5.0 * (np.arange(len(PARTS)) == ARM)
    away = whole.observed_m + 0.05 * (KNOWN == LEFT_HAND)[:, None]
    for pose in (whole, without, replace(whole, observed_m=away), replace(without, single_cameras=np.zeros(8))):
        told += errors.notes(replace(pose, confidence=0.9, part_errors_deg=arm))
    assert [note.text for note in told] == [
        "left arm uncertain: its motion is not in the database",
        "left arm uncertain: its marker is hidden",
        "left arm uncertain: its marker does not fit",
        "left arm uncertain: its motion is not in the database",
    ]
    for cameras, text in ((1, "the camera"), (2, "both cameras"), (4, "all cameras")):
        (note,) = PartErrors(model, cameras).notes(replace(without, confidence=0.9, part_errors_deg=arm))
        assert note.text == f"left arm uncertain: its marker is hidden from {text}"
    assert errors.notes(replace(without, confidence=0.1, part_errors_deg=arm)) == []  # all of it is
    assert errors.notes(replace(without, confidence=0.9, part_errors_deg=DOUBTFUL_PART_DEG)) == []


def test_methods_without_a_prior_have_no_expected_errors(subject, database, record, noisy):
    pose = Session(subject, database, settings=SolveSettings(method="nearest")).step(record(noisy[0], 0, KNOWN))
    assert len(pose.part_errors_deg) == len(pose.joint_errors_deg) == 0
    assert pose.doubtful_parts == []
