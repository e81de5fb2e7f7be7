"""Draw the pictures in the documentation: marker sets and camera positions.

    python tools/make_drawings.py [--check]

`--check` writes nothing and fails if a drawing in docs/drawings is out of date.
"""

import sys
from collections.abc import Iterable
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np
from perfanim.core.body.calibration_poses import standing, t_pose
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.arrays import Array, IntArray
from perfanim.core.geometry.camera import Camera, CameraRig
from perfanim.core.markers.marker_set import MarkerSet, PointKind, load_marker_set, marker_set_names
from perfanim.core.simulate.studio.cones import RoundCones, visible
from perfanim.core.simulate.studio.limb_outlines import outlines
from perfanim.core.simulate.studio.performer_body import make_body, with_sticks
from perfanim.core.simulate.studio.studio_rig import looking_at
from perfanim.core.vision.common_space import common_space

DRAWINGS = Path(__file__).resolve().parents[1] / "docs" / "drawings"
_INK, _GREY, _PALE, _MARKER, _SPACE = "#333333", "#8a8a8a", "#e3e7ec", "#c22f2f", "#bfe3c4"
# marker sets, in pixels
_METRE = 225.0
_VIEW, _TOP, _FLOOR = 440.0, 62.0, 30.0
_ROW, _COLUMN, _HEAD = 17.0, 268.0, 44.0
_MOST_ROWS = 21
_FAR_M = 50.0  # distance from which a view is practically parallel
_FEW = 15  # number of markers that a view from the front shows well enough
# two typical webcams
_FIELD_DEG, _SIZE = 64.0, (1280, 720)  # horizontal field of view, degrees; pixels
_APART_M, _AWAY_M, _HEIGHTS_M, _AIM_M, _TALL_M = 1.6, 3.4, (1.1, 1.7), 0.9, 1.8
_PLAN_METRE, _BACK_M = 80.0, -3.4  # pixels per metre; z at which the plan ends


def main(arguments: list[str]) -> int:
    """Write the drawings, or check them; return 1 if one is outdated, missing or left over."""
    rig = usual_rig()
    worn = [each for each in map(load_marker_set, marker_set_names()) if each.points is PointKind.MARKERS]
    wanted = {f"markers-{each.name}.svg": draw_marker_set(each) for each in worn}
    wanted |= {"cameras-from-above.svg": draw_plan(rig), "cameras-from-the-side.svg": draw_side(rig)}
    if "--check" not in arguments:
        DRAWINGS.mkdir(exist_ok=True)
        for name, content in wanted.items():
            (DRAWINGS / name).write_text(content, encoding="utf-8")
        return 0
    there = {path.name: path.read_text(encoding="utf-8") for path in DRAWINGS.glob("*.svg")}
    old = sorted(name for name in there.keys() | wanted.keys() if there.get(name) != wanted.get(name))
    if old:
        sys.stderr.write(f"docs/drawings: out of date: {', '.join(old)}; run `python tools/make_drawings.py`\n")
    return 1 if old else 0


# ---- SVG, one line per shape


def _document(width: float, height: float, parts: Iterable[str]) -> str:
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:.0f} {height:.0f}" font-family="sans-serif">'
    return "\n".join([head, f'<rect width="{width:.0f}" height="{height:.0f}" fill="white"/>', *parts, "</svg>"]) + "\n"


def _polygon(points: Array, fill: str, stroke: str = "none") -> str:
    text = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    return f'<polygon points="{text}" fill="{fill}" stroke="{stroke}"/>'


def _line(x1: float, y1: float, x2: float, y2: float, colour: str, dashed: bool = False) -> str:
    dash = ' stroke-dasharray="4 3"' if dashed else ""
    return f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}" stroke="{colour}"{dash}/>'


def _circle(x: float, y: float, radius: float, fill: str, stroke: str = "none") -> str:
    return f'<circle cx="{x:.1f}" cy="{y:.1f}" r="{radius:.1f}" fill="{fill}" stroke="{stroke}"/>'


def _text(x: float, y: float, words: str, size: float = 12.0, anchor: str = "start", bold: bool = False) -> str:
    weight = ' font-weight="bold"' if bold else ""
    style = f'font-size="{size:.0f}" text-anchor="{anchor}" fill="{_INK}"{weight}'
    return f'<text x="{x:.1f}" y="{y:.1f}" {style}>{escape(words)}</text>'


# ---- marker sets


def draw_marker_set(marker_set: MarkerSet) -> str:
    """Return the SVG for a set: numbered markers on a body in a T pose, and their names.

    Large sets also get a view from behind. A marker on the far side is a ring, numbered only if no other view shows it.
    Left and right are the performer's own.
    """
    skeleton = default_skeleton()
    pose, root = t_pose(skeleton), np.zeros(3)
    joints = marker_set.joint_indices(skeleton)
    cones = with_sticks(make_body(skeleton), joints, marker_set.offsets_m).cones(pose, root)
    sole_m = min((cones.starts[:, 1] - cones.start_radii).min(), (cones.ends[:, 1] - cones.end_radii).min())
    lift = np.array([0.0, -sole_m, 0.0])
    cones = RoundCones(cones.starts + lift, cones.ends + lift, cones.start_radii, cones.end_radii)
    positions, world = forward_kinematics(skeleton, pose, root)
    markers_m = positions[joints] + rot.rotate(world[joints], marker_set.offsets_m) + lift
    floor = _TOP + _METRE * float(max(markers_m[:, 1].max() + 0.05, (cones.ends[:, 1] + cones.end_radii).max()))
    views = (1.0,) if len(marker_set) <= _FEW else (1.0, -1.0)
    parts = [_text(14, 24, f"{marker_set.name}: {len(marker_set)} markers", 15, bold=True)]
    for number, side in enumerate(views):
        parts += _view(cones, markers_m, side, (number + 0.5) * _VIEW, floor)
    left = len(views) * _VIEW + 20.0
    rows = min(_MOST_ROWS, len(marker_set))
    for index, (name, words) in enumerate(zip(marker_set.names, marker_set.texts, strict=True)):
        x, y = left + _COLUMN * (index // rows), _HEAD + _ROW * (index % rows)
        parts.append(_text(x, y, f"{index + 1}  {name}" + (f": {words}" if words != name else ""), 11))
    width = left + _COLUMN * (-(-len(marker_set) // rows))
    return _document(width, max(floor + _FLOOR, _HEAD + _ROW * rows), parts)


def _view(cones: RoundCones, markers_m: Array, side: float, middle: float, floor: float) -> list[str]:
    """Return a view from the front (side 1) or from behind (-1)."""

    def page(points_m: Array) -> Array:
        return np.stack((middle + side * _METRE * points_m[:, 0], floor - _METRE * points_m[:, 1]), axis=1)

    radii = [_METRE * radius for radius in (cones.start_radii, cones.end_radii)]
    parts = [_polygon(outline, _PALE) for outline in outlines(page(cones.starts), page(cones.ends), *radii)]
    eye = np.array([0.0, 1.0, side * _FAR_M])
    near = visible(eye, markers_m, cones, 0.01)
    pixels = page(markers_m)
    for (x, y), seen in sorted(zip(pixels.tolist(), near.tolist(), strict=True), key=lambda row: row[1]):
        parts.append(_circle(x, y, 4.0, _MARKER if seen else "white", _MARKER))
    numbered = np.flatnonzero(near | ~visible(eye * [1.0, 1.0, -1.0], markers_m, cones, 0.01))
    for number, (x, y) in zip(numbered.tolist(), _label_places(pixels, numbered), strict=True):
        parts.append(_text(x, y + 3.5, str(number + 1), 10, "middle"))
    words = ("from the front", "right", "left") if side > 0 else ("from behind", "left", "right")
    places = (middle, middle - 0.42 * _VIEW, middle + 0.42 * _VIEW)
    return parts + [_text(x, floor + 20, word, 11, "middle") for x, word in zip(places, words, strict=True)]


def _label_places(pixels: Array, numbered: IntArray) -> Array:
    """Return free positions next to some of the dots (N, 2), for their numbers."""
    angles = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
    ring = 11.0 * np.stack((np.cos(angles), np.sin(angles)), axis=1)
    taken, places = pixels, np.empty((0, 2))
    for index in numbered:
        candidates = pixels[index] + ring
        free = np.linalg.norm(candidates[:, None] - taken, axis=2).min(axis=1)
        place = candidates[np.argmax(np.minimum(free, 11.0))]
        taken, places = np.vstack((taken, place)), np.vstack((places, place))
    return places


# ---- camera positions


def usual_rig() -> CameraRig:
    """Return two webcams placed as the page recommends, with the world on the floor."""
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
    parts = [_polygon(_plan(_field(camera)), "#f3f5f8", _GREY) for camera in rig.cameras]
    parts.append(_polygon(_plan(np.array(outline)), _SPACE))
    box = _plan(np.array([(left, back), (right, back), (right, front), (left, front)]))
    parts.append(_polygon(box, "none", "#2c7a3a"))
    x, y = box.mean(axis=0)
    parts.append(_text(x, y, space.text, 13, "middle"))
    for camera in rig.cameras:
        x, y = _plan(camera.centre_m[None, [0, 2]])[0]
        aside, anchor = (-14, "end") if camera.centre_m[0] < 0.0 else (14, "start")
        parts.append(_circle(x, y, 7, _INK))
        parts.append(_text(x + aside, y + 4, f"{camera.name} camera, lamp at its lens", 12, anchor))
    width, height = 2.0 * _plan(np.zeros((1, 2)))[0, 0], y + 48
    parts.append(_text(0.5 * width, y + 30, f"{_APART_M:g} m apart, {_AWAY_M:g} m from the middle", 12, "middle"))
    title = f"From above. Green: both see {_TALL_M:g} m of you, head to foot"
    return _document(width, height, [_text(14, 24, title, 15, bold=True), *parts])


def _field(camera: Camera) -> Array:
    """Return the part of the floor plan (4, 2), x and z, in a camera's field of view."""
    place = camera.centre_m[[0, 2]]
    edges = camera.rays(camera.undistort(np.array([[0.0, 0.5 * _SIZE[1]], [_SIZE[0], 0.5 * _SIZE[1]]])))[:, [0, 2]]
    return np.concatenate((place[None], place + edges * ((_BACK_M - place[1]) / edges[:, 1])[:, None]))


def _plan(points_m: Array) -> Array:
    """Return pixels (N, 2) of floor positions x, z (N, 2)."""
    return np.array([330.0, 50.0]) + _PLAN_METRE * (points_m - np.array([0.0, _BACK_M]))


def draw_side(rig: CameraRig) -> str:
    """Return the view from the side: heights and fields of the cameras."""
    floor, scale, left = 270.0, 100.0, 130.0

    def page(z: Array, y: Array) -> Array:
        return np.stack((left + scale * z, floor - scale * y), axis=1)

    skeleton = default_skeleton()
    cones = make_body(skeleton).cones(standing(skeleton), np.zeros(3))
    sole_m = (cones.ends[:, 1] - cones.end_radii).min()
    ends = [page(points[:, 2], points[:, 1] - sole_m) for points in (cones.starts, cones.ends)]
    parts = [_line(20, floor, 560, floor, _INK)]
    for camera in rig.cameras:
        _, y, z = camera.centre_m
        tilt, half = np.arctan2(_AIM_M - y, _AWAY_M), np.arctan(0.5 * _SIZE[1] / camera.focal_px)
        reach = _AWAY_M + 0.7
        far = [(z - reach, y + reach * np.tan(tilt + field)) for field in (-half, half)]
        (x_px, y_px), *edges = page(*np.array([(z, y), *far]).T)
        parts += [_line(x_px, y_px, x, y_far, _GREY, True) for x, y_far in edges]
        parts += [_circle(x_px, y_px, 7, _INK), _text(x_px + 14, y_px + 4, f"{y:g} m high")]
    radii = [scale * radius for radius in (cones.start_radii, cones.end_radii)]
    parts += [_polygon(outline, _PALE) for outline in outlines(*ends, *radii)]
    parts.append(_text(left + 0.5 * scale * _AWAY_M, floor + 22, f"{_AWAY_M:g} m", 12, "middle"))
    parts.append(_text(14, 24, "From the side: one camera lower, one higher, aimed at the waist", 15, bold=True))
    return _document(580, floor + 40, parts)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
