from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.errors import TakeError
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.rigid_transform import transform
from perfanim.core.markers.floor_from_feet import floor_points, to_rig_world
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.marker_take import MarkerTake
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.vision.calibration.rig_on_floor import rig_on_floor

MARKERS = "two-webcams"


def tilted(take: MarkerTake, rotation: np.ndarray, shift: np.ndarray) -> MarkerTake:
    """The take in a world that is turned and moved."""
    return replace(take, positions_m=transform(rotation, shift, take.positions_m))


@pytest.fixture(scope="module")
def walking(embedded_motion):
    """Markers of a walk on the floor y = 0, with the noise that a far performer has."""
    return simulate_markers(embedded_motion["walking-02-energetic"], load_marker_set(MARKERS), noise_mm=5.0, seed=1)[0]


def test_floor_is_found_in_a_rolled_and_pitched_world(walking):
    rotation = rot.to_matrix(rot.from_rotation_vector([np.radians(8.0), 0.3, np.radians(-12.0)]))
    shift = np.array([0.4, -0.9, -3.0])
    points = floor_points(tilted(walking, rotation, shift), load_marker_set(MARKERS))
    level = (points - shift) @ rotation  # back in the world whose floor is y = 0
    np.testing.assert_allclose(level[:, 1].mean(), 0.0, atol=0.02)
    normal = np.cross(level[1] - level[0], level[2] - level[0])
    tilt = np.degrees(np.arccos(abs(normal[1]) / np.linalg.norm(normal)))
    assert tilt < 1.5


def test_take_is_moved_to_the_rigs_world(walking, stage_rig):
    marker_set = load_marker_set(MARKERS)
    level = rig_on_floor(stage_rig, floor_points(walking, marker_set))
    moved = to_rig_world(walking, stage_rig, level)
    for before, after in zip(stage_rig.cameras, level.cameras, strict=True):
        np.testing.assert_allclose(
            after.to_camera(moved.positions_m[::20]), before.to_camera(walking.positions_m[::20]), atol=1e-9
        )
    assert np.nanmin(moved.positions_m[..., 1]) == pytest.approx(np.nanmin(walking.positions_m[..., 1]), abs=0.04)


def test_takes_without_stands_are_refused(walking):
    lifted = walking.positions_m.copy()
    lifted[:, :, 0] += 0.5 * np.arange(walking.frames)[:, None]  # 15 m/s: nothing ever rests
    with pytest.raises(TakeError, match="no foot stays planted"):
        floor_points(replace(walking, positions_m=lifted), load_marker_set(MARKERS))
    with pytest.raises(TakeError, match="has no marker HEAD"):
        floor_points(walking, load_marker_set("boxing"))
    whole = load_marker_set(MARKERS)
    without = replace(whole, markers=tuple(m for m in whole.markers if not m.joint.endswith("foot")))
    with pytest.raises(TakeError, match="no marker on the feet"):
        floor_points(walking, without)
