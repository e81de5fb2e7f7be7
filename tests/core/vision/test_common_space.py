"""The floor that all cameras see: its rectangle is seen, and as large as can be."""

from dataclasses import replace

import numpy as np
import pytest
from perfanim.core.geometry.camera import CameraRig
from perfanim.core.simulate.studio.studio_rig import default_rig
from perfanim.core.vision.common_space import _largest_rectangle, common_space

HEIGHT_M, AROUND_M, RADIUS_M, SMALLEST_PX = 1.8, 0.35, 0.0125, 1.5


def is_seen(camera, x, z):
    corners = [
        (x + dx, y, z + dz) for dx in (-AROUND_M, AROUND_M) for dz in (-AROUND_M, AROUND_M) for y in (0, HEIGHT_M)
    ]
    pixels, depth = camera.project(corners), camera.to_camera(corners)[:, 2]
    inside = np.all((pixels >= 0) & (pixels <= np.array(camera.image_size) - 1))
    return bool(inside and np.all(camera.focal_px * RADIUS_M / depth > SMALLEST_PX))


@pytest.mark.parametrize("cameras", [1, 2, 3])
def test_rectangle_is_visible_and_cannot_grow(cameras):
    rig = default_rig(cameras)
    space = common_space(rig, HEIGHT_M, AROUND_M, RADIUS_M, SMALLEST_PX)
    left, back, right, front = space.rectangle_m
    assert right - left > 0.5 and front - back > 0.3
    for x in (left, right):
        for z in (back, front):
            assert all(is_seen(camera, x, z) for camera in rig.cameras)
    step = float(space.x_m[1] - space.x_m[0])
    for sides in ([(x, front + step) for x in (left, right)], [(left - step, z) for z in (back, front)]):
        assert not all(is_seen(camera, x, z) for camera in rig.cameras for x, z in sides)
    width, depth = space.size_m
    assert space.text.startswith(f"you may walk {width:.1f} x {depth:.1f} m")


def test_the_space_with_images_twice_as_wide_is_that_of_such_cameras():
    rig = default_rig()
    twice = np.diag([2.0, 2.0, 1.0])
    sharp = CameraRig(
        tuple(
            replace(camera, matrix=twice @ camera.matrix, image_size=tuple(2 * side for side in camera.image_size))
            for camera in rig.cameras
        )
    )
    space, sharper = common_space(rig), common_space(sharp)
    step = float(space.x_m[1] - space.x_m[0])
    np.testing.assert_allclose(space.sharper_m, sharper.rectangle_m, atol=1.01 * step)
    left, back, right, front = space.sharper_m
    assert space.text.endswith(f"; with images twice as wide {right - left:.1f} x {front - back:.1f} m")
    assert "twice" not in sharper.text  # the lenses end it, not the images


def test_largest_rectangle_equals_that_of_an_exhaustive_search():
    rng = np.random.default_rng(1)
    for _ in range(50):
        seen = rng.random((5, 6)) < 0.7
        found = _largest_rectangle(seen, np.arange(6.0), np.arange(5.0))
        sizes = [
            (x2 - x1 + 1) * (z2 - z1 + 1)
            for x1 in range(6) for x2 in range(x1, 6) for z1 in range(5) for z2 in range(z1, 5)
            if seen[z1 : z2 + 1, x1 : x2 + 1].all()
        ]  # fmt: skip
        assert (found[2] - found[0] + 1) * (found[3] - found[1] + 1) == max(sizes)


def test_diverging_cameras_have_no_common_space():
    left, right = default_rig(2).cameras
    rotation = np.diag([-1.0, 1.0, -1.0]) @ right.rotation
    turned = replace(right, rotation=rotation, translation_m=-rotation @ right.centre_m)
    space = common_space(CameraRig((left, turned)))
    assert space.size_m == (0.0, 0.0)
    assert "nowhere" in space.text
