"""A man who balances on a beam, filmed by four cameras: every pair of them, and each alone, gives his motion."""

import logging
from dataclasses import replace
from itertools import combinations
from statistics import fmean

import numpy as np
import pytest
from perfanim.core.api.solving import SolveRequest, solve
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.geometry.camera import CameraRig
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.vision.people.body_network import BlazePose
from perfanim.core.vision.people.people_pipeline import PersonLocator
from perfanim.core.vision.tracked_take import labelled_take

PAIRED = ("humerus", "radius", "wrist", "femur", "tibia", "foot")
FPS = 60.0
LOG = logging.getLogger(__name__)
# median, and 90th percentile of the joints' distances from the motion of all four cameras that are asked for
MEDIAN_M, MOST_M = 0.04, 0.07
HEIGHT_M = 1.61  # of the body that all four cameras give
AT_AN_ANGLE = ((0, 3), (2, 3))  # cameras 108 and 68 degrees apart

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def joints_of(beam):
    """joints_of((0, 1)) -> skeleton and joints (F, J, 3) by these cameras."""
    rig, frames = beam
    points = load_marker_set(BlazePose.marker_set)

    def joints(cameras, height_m=None):
        some = CameraRig(tuple(rig.cameras[camera] for camera in cameras), rig.metadata)
        bare = []
        for frame in frames:
            blobs = tuple(frame.blobs[camera] for camera in cameras)
            times_s = frame.camera_times_s[list(cameras)]
            bare.append(
                replace(frame, blobs=blobs, detected=blobs, camera_times_s=times_s, point_blobs=np.empty((0, 0)))
            )
        located = PersonLocator(some, points).locate_all(bare)
        take = labelled_take(located, points.names, "beam", FPS, some)
        motion = solve(take, request=SolveRequest(height_m=height_m)).motion
        return motion.skeleton, forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)[0]

    return joints


@pytest.fixture(scope="module")
def by_all(joints_of):
    return joints_of((0, 1, 2, 3))


@pytest.mark.parametrize("pair", list(combinations(range(4), 2)))
def test_no_limb_of_any_pair_of_cameras_is_on_the_other_side(joints_of, by_all, pair):
    skeleton, whole_m = by_all
    _, joints_m = joints_of(pair)
    for name in PAIRED:
        sides = [skeleton.index(side + name) for side in "lr"]
        own, other = (
            np.linalg.norm(joints_m[:, sides] - whole_m[:, order], axis=-1).sum(axis=1)
            for order in (sides, sides[::-1])
        )
        assert np.all(own < other), name
    if pair in AT_AN_ANGLE:
        away_m = np.linalg.norm(joints_m - whole_m, axis=-1)
        assert np.median(away_m) < MEDIAN_M
        assert np.percentile(away_m, 90) < MOST_M
        ends = [skeleton.index(side + name) for side in "lr" for name in ("wrist", "foot")]
        assert fmean(np.linalg.norm(np.diff(joints_m[:, ends], 2, axis=0), axis=-1).mean(axis=0)) < 0.004  # as asked


@pytest.mark.parametrize("camera", range(4))
def test_one_camera_gives_the_motion_across_its_view(beam, joints_of, by_all, camera):
    rig, _ = beam
    _, whole_m = by_all
    _, joints_m = joints_of((camera,), HEIGHT_M)
    view = whole_m - rig.cameras[camera].centre_m
    view /= np.linalg.norm(view, axis=-1, keepdims=True)
    along_m = np.sum((joints_m - whole_m) * view, axis=-1)
    across_m = np.linalg.norm(joints_m - whole_m - along_m[..., None] * view, axis=-1)
    in_root_m = np.linalg.norm((joints_m - joints_m[:, :1]) - (whole_m - whole_m[:, :1]), axis=-1)
    LOG.info(
        "camera %d: about the root %.0f mm, 90 %% %.0f mm; along the view %.0f mm, across it %.0f mm",
        camera + 1, *(1e3 * np.percentile(in_root_m, (50, 90))), 1e3 * np.median(np.abs(along_m)),
        1e3 * np.median(across_m),
    )  # fmt: skip
    assert np.median(across_m) < 0.05
    assert np.median(np.abs(along_m)) < 0.2
    assert np.median(in_root_m) < 0.1
