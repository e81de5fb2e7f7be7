"""A man who balances on a beam, filmed by four cameras: every pair of them gives his motion."""

from dataclasses import replace
from itertools import combinations
from statistics import fmean

import numpy as np
import pytest
from perfanim.core.api.solving import solve
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.geometry.camera import CameraRig
from perfanim.core.geometry.rig_file import load_rig
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.vision.people.body_network import BlazePose
from perfanim.core.vision.people.network_file import body_network_file
from perfanim.core.vision.people.people_pipeline import PeoplePipeline, PersonLocator
from perfanim.core.vision.sources.source_kinds import open_image_source
from perfanim.core.vision.tracked_take import labelled_take

PAIRED = ("humerus", "radius", "wrist", "femur", "tibia", "foot")
FPS = 60.0
# median, and 90th percentile of the joints' distances from the motion of all four cameras that are asked for
MEDIAN_M, MOST_M = 0.04, 0.07
AT_AN_ANGLE = ((0, 3), (2, 3))  # cameras 108 and 68 degrees apart

pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def seen(shared_dir):
    """The calibrated cameras, and the person in each of their pictures."""
    if not body_network_file().is_file():
        pytest.skip("the body network is not here: perfanim network get")
    films = shared_dir / "people" / "walk-on-beam"
    rig, network = load_rig(films / "Calib.qca.txt"), BlazePose(body_network_file())
    pipeline = PeoplePipeline(rig, [network] * len(rig))
    source = open_image_source(*(str(films / f"cam0{number}.mp4") for number in range(1, 5)))
    return rig, [pipeline.detect(images) for images in source]


@pytest.fixture(scope="module")
def joints_of(seen):
    """joints_of((0, 1)) -> skeleton and joints (F, J, 3) by these cameras."""
    rig, frames = seen
    points = load_marker_set(BlazePose.marker_set)

    def joints(cameras):
        some = CameraRig(tuple(rig.cameras[camera] for camera in cameras), rig.metadata)
        bare = []
        for frame in frames:
            blobs = tuple(frame.blobs[camera] for camera in cameras)
            times_s = frame.camera_times_s[list(cameras)]
            bare.append(
                replace(frame, blobs=blobs, detected=blobs, camera_times_s=times_s, point_blobs=np.empty((0, 0)))
            )
        located = PersonLocator(some, points).locate_all(bare)
        motion = solve(labelled_take(located, points.names, "beam", FPS, some)).motion
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
