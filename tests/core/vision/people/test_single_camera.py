"""A person whom one camera sees: placed by size and floor, and solved."""

import logging

import numpy as np
import pytest
from filmed_people import POINTS, keypoints, moments, networks
from perfanim.core.api import fit_subject
from perfanim.core.api.solving import solve
from perfanim.core.body.motion import sliced
from perfanim.core.body.motion_metrics import evaluate
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.geometry.camera import CameraRig
from perfanim.core.markers.subject import Subject
from perfanim.core.simulate.shipped_performance import performance
from perfanim.core.simulate.simulated_keypoints import KeypointErrors, keypoint_errors
from perfanim.core.simulate.studio.studio_rig import default_rig
from perfanim.core.vision.people.people_pipeline import PeoplePipeline
from perfanim.core.vision.tracked_take import labelled_take, relocate

FPS = 30.0
LOG = logging.getLogger(__name__)
# errors of the network: those of points across the rays, and those of its guesses of depth, which are 0.5 to 0.8 of the
# true depths about the hips (see docs/tuning-log.md)
ACROSS = KeypointErrors(slow_m=0.025, fast_m=0.006)
ALONG = KeypointErrors(slow_m=0.08, fast_m=0.02)
FLATTENED = 0.65


def single(floor):
    rig = default_rig()
    return CameraRig(rig.cameras[:1], {**rig.metadata, "floor": floor})


def filmed(motion, rig, noisy=False):
    """Return the frames in which a network finds the person of a motion."""
    points_m = keypoints(motion)
    nets = networks(rig, points_m)
    random = np.random.default_rng(3)
    for c, (camera, network) in enumerate(zip(rig.cameras, nets, strict=True) if noisy else ()):
        shape = motion.frames, len(POINTS), FPS, random
        found_m, deep_m = points_m + keypoint_errors(*shape, ACROSS), keypoint_errors(*shape, ALONG)[..., 2]
        for n, row in enumerate(found_m):
            local_m = camera.to_camera(row)
            local_m[:, 2] = FLATTENED * local_m[:, 2] + deep_m[n]
            network.pixels[10 * n + c], network.points_m[10 * n + c] = camera.project(row), local_m
    pipeline = PeoplePipeline(rig, nets)
    return [pipeline.process(images) for images in moments(rig, motion.frames, FPS)]


@pytest.fixture(scope="module")
def walk():
    return sliced(performance("walking", 6.0, FPS, default_skeleton()), 60, 150)


def test_an_average_person_is_placed_by_size(walk):
    frame = filmed(walk, single(floor=False))[5]
    assert frame.labels.tolist() == frame.single_labels.tolist() == list(range(len(POINTS)))
    np.testing.assert_allclose(frame.points_m, keypoints(walk)[5], atol=1e-4)


def test_on_a_known_floor_the_feet_show_the_size(walk):
    small = sliced(performance("walking", 6.0, FPS, default_skeleton(1.4)), 60, 150)
    rig = single(floor=True)
    frames = filmed(small, rig)
    away_m = np.linalg.norm(frames[-1].points_m - keypoints(small)[len(frames) - 1], axis=1)
    by_size_m = np.linalg.norm(filmed(small, single(floor=False))[-1].points_m - keypoints(small)[-1], axis=1)
    assert np.median(away_m) < 0.1 < 0.5 < np.median(by_size_m)
    take = labelled_take(relocate(rig, frames), POINTS.names, "small", FPS, rig)
    assert fit_subject(take, None).skeleton.offsets_m == pytest.approx(default_skeleton(1.4).offsets_m, rel=0.05)


@pytest.mark.long
@pytest.mark.parametrize("floor", [False, True])
def test_one_camera_gives_the_motion_and_half_the_confidence_at_most(database, floor):
    tall = sliced(performance("walking", 6.0, FPS, default_skeleton(1.85)), 60, 150)
    anna = Subject("Anna", default_skeleton(1.85), POINTS)
    alone = single(floor)
    both = CameraRig(default_rig().cameras, alone.metadata)
    solved = {}
    for rig in (alone, both):
        take = labelled_take(relocate(rig, filmed(tall, rig, noisy=True)), POINTS.names, "walk", FPS, rig)
        solved[len(rig)] = solve(take, anna, database)
    measures = evaluate(solved[1].motion, tall)
    true_m, joints_m = (
        forward_kinematics(each.skeleton, each.rotations, each.root_positions_m)[0][: tall.frames]
        for each in (tall, solved[1].motion)
    )
    view = true_m - alone.cameras[0].centre_m
    view /= np.linalg.norm(view, axis=-1, keepdims=True)
    along_m = np.sum((joints_m - true_m) * view, axis=-1)
    across_m = np.linalg.norm(joints_m - true_m - along_m[..., None] * view, axis=-1)
    confidence = {count: np.mean([pose.confidence for pose in each.poses_of()]) for count, each in solved.items()}
    LOG.info(
        "floor %s: mpjpe %.0f mm, bones %.1f degrees, along the view %.0f mm, across it %.0f mm (medians); "
        "feet slide by %.0f cm/s; confidence %.2f, with two cameras %.2f",
        floor, measures["mpjpe_mm"], measures["bone_direction_deg"], 1e3 * np.median(np.abs(along_m)),
        1e3 * np.median(across_m), measures["foot_skate_cm_s"], confidence[1], confidence[2],
    )  # fmt: skip
    assert measures["mpjpe_mm"] < 70.0
    assert np.median(across_m) < 0.025 < np.median(np.abs(along_m)) < 0.1
    assert max(pose.confidence for pose in solved[1].poses_of()) <= 0.5
