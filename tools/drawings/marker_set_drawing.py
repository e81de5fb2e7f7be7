"""Drawing of a marker set on a standing body, from its file."""

from dataclasses import dataclass

import numpy as np
from perfanim.core.body.calibration_poses import t_pose
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.arrays import Array, IntArray, Mask
from perfanim.core.markers.marker_set import MarkerSet
from perfanim.core.simulate.studio.cones import RoundCones, visible
from perfanim.core.simulate.studio.limb_outlines import outlines
from perfanim.core.simulate.studio.performer_body import make_body, with_sticks

from . import svg

_PIXELS_A_METRE = 225.0
_VIEW_PX, _TOP_PX, _FLOOR_PX = 440.0, 62.0, 30.0
_ROW_PX, _COLUMN_PX, _HEAD_PX = 17.0, 268.0, 44.0
_MOST_ROWS = 21
_FAR_M = 50.0  # as good as parallel
_FEW = 15  # markers that a view from the front shows well enough


@dataclass(frozen=True)
class _Worn:
    """A body with markers: its cones, and the markers' positions (M, 3), metres."""

    cones: RoundCones
    markers_m: Array


def draw_marker_set(marker_set: MarkerSet) -> str:
    """Return the SVG of a set: numbered markers on the body, and their names.

    Large sets get a view from behind as well. A marker on the far side is a ring, numbered only where no view shows it.
    The sides are the performer's own.
    """
    worn = _wear(marker_set)
    views = (1.0,) if len(marker_set) <= _FEW else (1.0, -1.0)
    top_m = float(max(worn.markers_m[:, 1].max() + 0.05, (worn.cones.ends[:, 1] + worn.cones.end_radii).max()))
    floor_px = _TOP_PX + top_m * _PIXELS_A_METRE
    parts = [svg.text(14, 24, f"{marker_set.name}: {len(marker_set)} markers", 15, bold=True)]
    for number, side in enumerate(views):
        parts += _draw_view(worn, side, (number + 0.5) * _VIEW_PX, floor_px)
    left_px = len(views) * _VIEW_PX + 20.0
    rows = min(_MOST_ROWS, len(marker_set))
    for index, (name, words) in enumerate(zip(marker_set.names, marker_set.texts, strict=True)):
        x, y = left_px + _COLUMN_PX * (index // rows), _HEAD_PX + _ROW_PX * (index % rows)
        parts.append(svg.text(x, y, f"{index + 1}  {name}" + (f": {words}" if words != name else ""), 11))
    width = left_px + _COLUMN_PX * (-(-len(marker_set) // rows))
    return svg.document(width, max(floor_px + _FLOOR_PX, _HEAD_PX + _ROW_PX * rows), parts)


def _wear(marker_set: MarkerSet) -> _Worn:
    """Return the set's markers on the average body in a T pose, soles at the height 0."""
    skeleton = default_skeleton()
    pose, root = t_pose(skeleton), np.zeros(3)
    joints = marker_set.joint_indices(skeleton)
    body = with_sticks(make_body(skeleton), joints, marker_set.offsets_m)
    cones = body.cones(pose, root)
    sole_m = min((cones.starts[:, 1] - cones.start_radii).min(), (cones.ends[:, 1] - cones.end_radii).min())
    positions, world = forward_kinematics(skeleton, pose, root)
    lift = np.array([0.0, -sole_m, 0.0])
    markers_m = positions[joints] + rot.rotate(world[joints], marker_set.offsets_m) + lift
    return _Worn(RoundCones(cones.starts + lift, cones.ends + lift, cones.start_radii, cones.end_radii), markers_m)


def _draw_view(worn: _Worn, side: float, middle_px: float, floor_px: float) -> list[str]:
    """Return a view from the front (side 1) or from behind (-1)."""
    cones = worn.cones
    ends = [_to_page(points, side, middle_px, floor_px) for points in (cones.starts, cones.ends)]
    radii = [_PIXELS_A_METRE * radius for radius in (cones.start_radii, cones.end_radii)]
    parts = [svg.polygon(outline, svg.PALE) for outline in outlines(*ends, *radii)]
    eye = np.array([0.0, 1.0, side * _FAR_M])
    near: Mask = visible(eye, worn.markers_m, cones, 0.01)
    pixels = _to_page(worn.markers_m, side, middle_px, floor_px)
    for (x, y), seen in sorted(zip(pixels.tolist(), near.tolist(), strict=True), key=lambda row: row[1]):
        parts.append(svg.circle(x, y, 4.0, svg.MARKER if seen else "white", svg.MARKER))
    numbered = np.flatnonzero(near | ~visible(eye * [1.0, 1.0, -1.0], worn.markers_m, cones, 0.01))
    for number, (x, y) in zip(numbered.tolist(), _label_places(pixels, numbered), strict=True):
        parts.append(svg.text(x, y + 3.5, str(number + 1), 10, "middle"))
    words = ("from the front", "right", "left") if side > 0 else ("from behind", "left", "right")
    parts.append(svg.text(middle_px, floor_px + 20, words[0], 11, "middle"))
    parts.append(svg.text(middle_px - 0.42 * _VIEW_PX, floor_px + 20, words[1], 11, "middle"))
    parts.append(svg.text(middle_px + 0.42 * _VIEW_PX, floor_px + 20, words[2], 11, "middle"))
    return parts


def _to_page(points_m: Array, side: float, middle_px: float, floor_px: float) -> Array:
    x = middle_px + side * _PIXELS_A_METRE * points_m[:, 0]
    return np.stack((x, floor_px - _PIXELS_A_METRE * points_m[:, 1]), axis=1)


def _label_places(pixels: Array, numbered: IntArray) -> Array:
    """Return free places beside some of the dots (N, 2), for their numbers."""
    angles = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
    ring = 11.0 * np.stack((np.cos(angles), np.sin(angles)), axis=1)
    taken, places = pixels, np.empty((0, 2))
    for index in numbered:
        candidates = pixels[index] + ring
        free = np.linalg.norm(candidates[:, None] - taken, axis=2).min(axis=1)
        place = candidates[np.argmax(np.minimum(free, 11.0))]
        taken, places = np.vstack((taken, place)), np.vstack((places, place))
    return places
