"""The benchmark of what the cameras' side delivers."""

from dataclasses import replace

import numpy as np
import pytest
from bench.vision import centroid_row, in_world_of
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.camera import CameraRig
from perfanim.core.simulate.studio.studio_rig import default_rig


@pytest.mark.parametrize("radius_px", [2.0, 3.0])
def test_discs_are_found_to_a_small_part_of_a_pixel(radius_px):
    row = centroid_row(radius_px)
    assert row["found"] == 1.0
    # at most what is asked of the product; 2 grey levels of noise leave a few thousandths to a perfect estimate
    assert 0.002 < row["rms_px"] <= 0.012


def test_a_calibration_in_another_world_is_brought_into_the_true_one():
    true = default_rig()
    turn = rot.to_matrix(rot.from_rotation_vector([0.3, -1.0, 0.2]))
    shift = np.array([1.0, -2.0, 0.5])
    elsewhere = CameraRig(
        tuple(
            replace(
                camera,
                rotation=camera.rotation @ turn.T,
                translation_m=camera.translation_m - camera.rotation @ turn.T @ shift,
            )
            for camera in true.cameras
        )
    )
    back = in_world_of(elsewhere, true)
    for found, camera in zip(back.cameras, true.cameras, strict=True):
        np.testing.assert_allclose(found.rotation, camera.rotation, atol=1e-12)
        np.testing.assert_allclose(found.centre_m, camera.centre_m, atol=1e-12)
