"""Marker takes from other programs, solved without any settings: suit, coverage, fit, verdict and a picture of each."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
from perfanim.core.api.solving import solve
from perfanim.core.api.take_reading import fit_take, labelled_by, read_labelled
from perfanim.core.body.body_parts import PART_JOINTS
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.database.store import open_database
from perfanim.core.errors import FormatError, PerfanimError
from perfanim.core.formats.markers.marker_files import READABLE
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.arrays import Array, Image, evenly
from perfanim.core.markers.label_matching import AUTO, normalise_label
from perfanim.core.markers.marker_take import MarkerTake
from perfanim.core.session.solved_take import SolvedTake
from perfanim.core.subjects.from_motion import frames_of

from .run import Run

_FOLDERS = ("c3d", "trc")
# joint -> labels of its centre in files of Plug-in Gait, of Davis' protocol, and of others
_CENTRES = {
    side + joint: [side + ending for ending in endings]
    for side in "lr"
    for joint, endings in {
        "femur": ("fep", "hjc", "hip"),
        "tibia": ("feo", "kjc", "knee"),
        "foot": ("tio", "ajc", "ankle"),
    }.items()
}
_COLUMNS = ("frames", "markers", "set", "known", "placed", "left_out", "residual_mm", "joints_mm", "moved_mm")
_POSES = 6  # poses in a picture
_CELL = (200, 240)  # pixels, width and height
_TALL_M = 2.2  # height that a cell shows
_UP = np.array([0.0, 1.0, 0.0])
Colour = tuple[int, int, int]
# BGR: sides and middle of the body, markers, lines to their solved positions, floor
_SIDES, _MIDDLE = {"l": (200, 110, 0), "r": (0, 130, 0)}, (90, 90, 90)
_MARKER, _OFF, _FLOOR = (0, 0, 220), (160, 120, 255), (220, 220, 220)


def marker_takes(run: Run, frames: int | None = None, only_takes: list[str] | None = None) -> dict[str, Any]:
    """Solve all marker takes of a folder with the suit and body found in them, and draw each.

    Pictures go to `pictures/`: poses at equal times from the front and from the side of the first pose; the left side
    of the body blue, the right green, markers red, with lines to their solved positions.

    Args:
        frames: Largest number of frames to solve, from the middle of a take; by default all.
        only_takes: Strings, one of which a take's path must contain; by default all takes are solved.

    Returns:
        rows (take, frames, markers, set, known, placed, left_out, residual_mm, joints_mm from the centres that the file
        has itself, moved_mm of the known marker farthest from its usual place if that is over 35, millimetres of
        each limb, verdict, or refusal in its place), outputs.

    Raises:
        FormatError: The folder contains no marker takes.
    """
    folder, wanted = run.data.resolve(), only_takes or [""]
    paths = sorted(
        path for name in _FOLDERS for path in (folder / name).rglob("*") if path.name.lower().endswith(READABLE)
    )
    paths = [path for path in paths if any(text in str(path) for text in wanted)]
    if not paths:
        raise FormatError("holds no marker takes", where=str(folder), advice="give the folder of c3d/ and trc/")
    pictures = run.out.resolve() / "pictures"
    pictures.mkdir(parents=True, exist_ok=True)
    database = run.embedded().path.resolve()
    jobs = {str(path.relative_to(folder)): (path, folder, pictures, database, frames) for path in paths}
    rows = run.each("marker-takes", _row, jobs, lambda row: [row])
    return run.write("marker-takes", {"rows": rows}, {"": rows})


def _row(path: Path, folder: Path, pictures: Path, database: Path, frames: int | None) -> dict[str, Any]:
    """Return the row for a take, in another process."""
    name = str(path.relative_to(folder))
    empty = dict.fromkeys((*_COLUMNS, *PART_JOINTS), "")
    row: dict[str, Any] = {"take": name, **empty, "verdict": "", "refusal": ""}
    try:
        read = read_labelled(path, None)
        row |= {"frames": read.frames, "markers": int(read.visible.any(axis=0).sum())}
        motion = open_database(database)
        named, worn = labelled_by(AUTO, read, motion, str(path))
        row["set"] = worn.name
        take = middle(fit_take(named, worn, "auto"), frames)
        solved = solve(take, None, motion)
    except PerfanimError as error:
        return row | {"refusal": str(error).replace(str(folder), "")}
    limbs = solved.verdict.limbs
    row |= {key: sum(getattr(limb, key) for limb in limbs) for key in ("known", "placed", "left_out")}
    row |= {limb.limb: round(1e3 * limb.distance_m, 1) for limb in limbs if limb.markers}
    picture = pictures / f"{name.replace('/', '_')}.png"
    cv2.imencode(".png", _picture(solved))[1].tofile(str(picture))
    row["joints_mm"] = _joints_mm(solved, take)
    row["moved_mm"] = next((f"{name} {mm:.0f}" for name, mm in solved.report["moved_mm"].items()), "")
    return row | {"residual_mm": round(solved.report["residual_mm"], 1), "verdict": solved.verdict.text}


def _joints_mm(solved: SolvedTake, take: MarkerTake) -> float | str:
    """Return the median distance of solved joints from the centres in the file; "" if it has none."""
    motion, poses = solved.motion, solved.poses_of()
    rotations, roots_m = (
        np.array([pose.rotations for pose in poses]),
        np.array([pose.root_position_m for pose in poses]),
    )
    joints_m = forward_kinematics(motion.skeleton, rotations, roots_m)[0]
    labels = {normalise_label(name.rpartition(":")[2]): at for at, name in enumerate(take.names)}
    known = {joint: [labels[name] for name in names if name in labels][:1] for joint, names in _CENTRES.items()}
    if not all(known.values()):
        return ""
    apart = [take.positions_m[:, at] - joints_m[:, motion.skeleton.index(joint)] for joint, (at,) in known.items()]
    apart_m = np.linalg.norm(apart, axis=-1)
    return round(1e3 * float(np.nanmedian(apart_m)), 1) if np.isfinite(apart_m).any() else ""


def middle(take: MarkerTake, frames: int | None) -> MarkerTake:
    """Return at most this many frames from the middle of a take."""
    if frames is None or take.frames <= frames:
        return take
    first = (take.frames - frames) // 2
    return frames_of(take, slice(first, first + frames))


def _picture(solved: SolvedTake) -> Image:
    """Return a picture of poses at equal times: front views above views of the left side."""
    poses, skeleton = solved.poses_of(), solved.motion.skeleton
    colours = [_SIDES.get(name[0], _MIDDLE) for name in skeleton.names]
    columns = []
    for pose in (poses[i] for i in evenly(len(poses), _POSES)):
        joints, world = (
            each[0] for each in forward_kinematics(skeleton, pose.rotations[None], pose.root_position_m[None])
        )
        starts, tips = joints[np.maximum(skeleton.parents, 0)], joints + rot.rotate(world, skeleton.tips_m)
        lines = [*zip(starts, joints, colours, strict=True), *zip(joints, tips, colours, strict=True)]
        marks = zip(pose.observed_m, pose.markers_m, strict=True)
        lines += [(seen, found, _OFF) for seen, found in marks if np.isfinite(seen).all()]
        forward = rot.rotate(pose.rotations[0], [0.0, 0.0, 1.0]) * [1.0, 0.0, 1.0]
        forward = forward / max(float(np.linalg.norm(forward)), 1e-9)
        left = np.cross(_UP, forward)
        columns.append(np.vstack([_cell(lines, pose.root_position_m, np.array([way, _UP])) for way in (left, forward)]))
    return np.hstack(columns)


def _cell(lines: list[tuple[Array, Array, Colour]], middle_m: Array, axes: Array) -> Image:
    """Return coloured lines in space, seen with the axes (2, 3) to the right and up, and markers at their starts."""
    width, height = _CELL
    image = np.full((height, width, 3), 255, np.uint8)
    scale = height / _TALL_M
    floor = round(height / 2 + scale * float(middle_m[1]))
    cv2.line(image, (0, floor), (width, floor), _FLOOR, 1)
    for start, end, colour in lines:
        flat = (np.array((start, end)) - middle_m) @ axes.T * scale
        ends = [(round(width / 2 + x), round(height / 2 - y)) for x, y in flat.tolist()]
        cv2.line(image, ends[0], ends[1], colour, 1 if colour == _OFF else 2, cv2.LINE_AA)
        if colour == _OFF:
            cv2.circle(image, ends[0], 2, _MARKER, -1, cv2.LINE_AA)
    return image
