"""Drawings of the cameras' places: the floor that both see, and their heights."""

import numpy as np
from perfanim.core.body.calibration_poses import standing
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.geometry.arrays import Array
from perfanim.core.geometry.camera import Camera, CameraRig
from perfanim.core.simulate.studio.limb_outlines import outlines
from perfanim.core.simulate.studio.performer_body import make_body
from perfanim.core.simulate.studio.studio_rig import looking_at
from perfanim.core.vision.common_space import common_space

from . import svg

_FIELD_DEG = 64.0  # horizontal, of a usual webcam
_SIZE = (1280, 720)
_APART_M, _AWAY_M, _HEIGHTS_M, _AIM_M = 1.6, 3.4, (1.1, 1.7), 0.9
_TALL_M = 1.8
_PIXELS_A_METRE = 80.0
_BACK_M = -3.4  # as far as the plan is drawn


def usual_rig() -> CameraRig:
    """Return two webcams as the page recommends them, their world on the floor."""
    focal = 0.5 * _SIZE[0] / np.tan(np.radians(0.5 * _FIELD_DEG))
    matrix = np.array([[focal, 0.0, 0.5 * _SIZE[0]], [0.0, focal, 0.5 * _SIZE[1]], [0.0, 0.0, 1.0]])
    cameras = []
    for name, side, height_m in zip(("left", "right"), (-1.0, 1.0), _HEIGHTS_M, strict=True):
        place = np.array([0.5 * side * _APART_M, height_m, _AWAY_M])
        rotation = looking_at(place, (0.0, _AIM_M, 0.0))
        cameras.append(Camera(name, _SIZE, matrix, rotation=rotation, translation_m=-rotation @ place))
    return CameraRig(tuple(cameras))


def draw_plan(rig: CameraRig) -> str:
    """Return the plan from above: the cameras' views and the floor that both see."""
    space = common_space(rig, _TALL_M)
    rows = [(z, space.x_m[row]) for z, row in zip(space.z_m, space.seen, strict=True) if row.any() and z >= _BACK_M]
    outline = [(xs[0], z) for z, xs in rows] + [(xs[-1], z) for z, xs in rows[::-1]]
    left, back, right, front = space.rectangle_m
    parts = [svg.polygon(_plan(_view(camera)), "#f3f5f8", svg.GREY) for camera in rig.cameras]
    parts.append(svg.polygon(_plan(np.array(outline)), svg.SPACE))
    box = _plan(np.array([(left, back), (right, back), (right, front), (left, front)]))
    parts.append(svg.polygon(box, "none", "#2c7a3a"))
    x, y = box.mean(axis=0)
    parts.append(svg.text(x, y, space.text, 13, "middle"))
    for camera in rig.cameras:
        x, y = _plan(camera.centre_m[None, [0, 2]])[0]
        anchor = "end" if camera.centre_m[0] < 0.0 else "start"
        words = f"{camera.name} camera, lamp at its lens"
        parts += [
            svg.circle(x, y, 7, svg.INK),
            svg.text(x + (-14 if anchor == "end" else 14), y + 4, words, 12, anchor),
        ]
    width, height = 2.0 * _plan(np.zeros((1, 2)))[0, 0], y + 48
    parts.append(svg.text(0.5 * width, y + 30, f"{_APART_M:g} m apart, {_AWAY_M:g} m from the middle", 12, "middle"))
    title = f"From above. Green: both see {_TALL_M:g} m of you, head to foot"
    return svg.document(width, height, [svg.text(14, 24, title, 15, bold=True), *parts])


def _view(camera: Camera) -> Array:
    """Return the part of the floor plan (4, 2), x and z, in a camera's field of view."""
    place = camera.centre_m[[0, 2]]
    edges = camera.rays(camera.undistort(np.array([[0.0, 0.5 * _SIZE[1]], [_SIZE[0], 0.5 * _SIZE[1]]])))[:, [0, 2]]
    far = place + edges * ((_BACK_M - place[1]) / edges[:, 1])[:, None]
    return np.concatenate((place[None], far))


def _plan(points_m: Array) -> Array:
    """Return pixels (N, 2) of floor positions x, z (N, 2)."""
    return np.array([330.0, 50.0]) + _PIXELS_A_METRE * (points_m - np.array([0.0, _BACK_M]))


def draw_side(rig: CameraRig) -> str:
    """Return the view from the side: heights and fields of the cameras."""
    floor_px, scale, left_px = 270.0, 100.0, 130.0

    def page(z: Array, y: Array) -> Array:
        return np.stack((left_px + scale * z, floor_px - scale * y), axis=1)

    skeleton = default_skeleton()
    cones = make_body(skeleton).cones(standing(skeleton), np.zeros(3))
    sole_m = (cones.ends[:, 1] - cones.end_radii).min()
    ends = [page(points[:, 2], points[:, 1] - sole_m) for points in (cones.starts, cones.ends)]
    parts = [svg.line(20, floor_px, 560, floor_px, svg.INK)]
    for camera in rig.cameras:
        tilt = np.arctan2(_AIM_M - camera.centre_m[1], _AWAY_M)
        field = np.arctan(0.5 * _SIZE[1] / camera.focal_px)
        z, y = camera.centre_m[2], camera.centre_m[1]
        reach = _AWAY_M + 0.7
        far = [(z - reach, y + reach * np.tan(tilt + half)) for half in (-field, field)]
        (x_px, y_px), *edges = page(*np.array([(z, y), *far]).T)
        parts += [svg.line(x_px, y_px, x, y, svg.GREY, True) for x, y in edges]
        parts += [svg.circle(x_px, y_px, 7, svg.INK), svg.text(x_px + 14, y_px + 4, f"{camera.centre_m[1]:g} m high")]
    radii = [scale * radius for radius in (cones.start_radii, cones.end_radii)]
    parts += [svg.polygon(outline, svg.PALE) for outline in outlines(*ends, *radii)]
    parts.append(svg.text(left_px + 0.5 * scale * _AWAY_M, floor_px + 22, f"{_AWAY_M:g} m", 12, "middle"))
    parts.append(svg.text(14, 24, "From the side: one camera lower, one higher, aimed at the waist", 15, bold=True))
    return svg.document(580, floor_px + 40, parts)
