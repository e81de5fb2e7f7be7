"""Files of the code of commit 140cb87 open with today's code and give what the old code read from them."""

import json
import math
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from perfanim.core.body.pose_notes import PoseNote
from perfanim.core.body.scene_pose import PerformerPose, PropPose
from perfanim.core.body.skeleton import Skeleton, forward_kinematics
from perfanim.core.cli.batch.plan import read_plan
from perfanim.core.database.store import identity, open_database
from perfanim.core.formats.markers.marker_files import read_take
from perfanim.core.formats.take_file.take_reader import TakeFile, read_take_file, summarise
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.camera import CameraRig
from perfanim.core.geometry.rig_file import load_rig
from perfanim.core.markers.label_matching import load_names
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.markers.marker_set import MarkerSet, load_marker_set
from perfanim.core.markers.prop import Prop, load_prop
from perfanim.core.markers.subject import Subject, load_subject
from perfanim.core.retarget.bone_map_files import read_bone_map

HERE = Path(__file__).parent
EXPECTED = json.loads((HERE / "expected.json").read_text(encoding="utf-8"))


def _digest(array: Any) -> dict[str, Any]:
    array = np.asarray(array)
    flat = np.nan_to_num(array.astype(float).ravel())
    weights = np.sin(np.arange(1, len(flat) + 1))
    return {
        "dtype": array.dtype.str,
        "shape": list(array.shape),
        "sum": float(flat.sum()),
        "weighted": float(flat @ weights),
    }


def _skeleton(skeleton: Skeleton) -> dict[str, Any]:
    return {
        "joints": " ".join(skeleton.names),
        "parents": _digest(skeleton.parents),
        "offsets_m": _digest(skeleton.offsets_m),
        "tips_m": _digest(skeleton.tips_m),
        "angle_axes": _digest(skeleton.angle_axes),
        "angle_orders": " ".join(skeleton.angle_orders),
    }


def _marker_set(markers: MarkerSet) -> dict[str, Any]:
    keys = ("name", "joint", "offset_m", "torso", "text", "also")
    return {
        "name": markers.name,
        "markers": [{key: getattr(marker, key) for key in keys} for marker in markers.markers],
    }


def _subject(subject: Subject) -> dict[str, Any]:
    return {
        "name": subject.name,
        "residual_m": subject.residual_m,
        "marker_set": _marker_set(subject.marker_set),
        "skeleton": _skeleton(subject.skeleton),
    }


def _rig(rig: CameraRig | None) -> dict[str, Any] | None:
    if rig is None:
        return None
    cameras = [
        {
            "name": camera.name,
            "image_size": camera.image_size,
            "matrix": camera.matrix,
            "distortion": camera.distortion,
            "rotation": camera.rotation,
            "rotation_vector": rot.to_rotation_vector(rot.from_matrix(camera.rotation)),
            "translation_m": camera.translation_m,
            "centre_m": camera.centre_m,
            "point_0_1_0_at_px": camera.project([0.0, 1.0, 0.0]),
        }
        for camera in rig.cameras
    ]
    return {"metadata": rig.metadata, "cameras": cameras}


def _prop(prop: Prop) -> dict[str, Any]:
    return {"name": prop.name, "names": prop.names, "positions_m": prop.positions_m, "residual_m": prop.residual_m}


def _pose(pose: PerformerPose, props: tuple[PropPose, ...]) -> dict[str, Any]:
    digests = {key: _digest(getattr(pose, key)) for key in ("rotations", "markers_m", "observed_m")}
    plain = ("number", "time_s", "root_position_m", "confidence", "single_cameras", "marker_rms_m", "neighbours",
             "dimensions", "notes")  # fmt: skip
    tables = [{key: getattr(prop, key) for key in ("rotation", "position_m", "rms_m", "seen")} for prop in props]
    return digests | {key: getattr(pose, key) for key in plain} | {"props": tables}


def _performer(take: TakeFile, index: int, subject: Subject) -> dict[str, Any]:
    """Return facts of one performer; the files have the props with the first."""
    poses = [solved.pose.performers[index] for solved in take.poses]
    props = [() if index else solved.pose.props for solved in take.poses]
    rotations = np.array([pose.rotations for pose in poses])
    roots = np.array([pose.root_position_m for pose in poses])
    joints = forward_kinematics(subject.skeleton, rotations, roots)[0]
    return {
        "name": subject.name,
        "poses": len(poses),
        "rotations": _digest(rotations),
        "root_positions_m": _digest(roots),
        "first": _pose(poses[0], props[0]),
        "last": _pose(poses[-1], props[-1]),
        "mean_confidence": np.mean([pose.confidence for pose in poses]),
        "left_hand_of_last_m": joints[-1, subject.skeleton.index("lhand")],
    }


def _frame(stamp_s: float, frame: MarkerFrame) -> dict[str, Any]:
    digests = {key: _digest(getattr(frame, key)) for key in ("points_m", "covariances_m2", "single_points")}
    plain = ("number", "time_s", "labels", "point_blobs", "single_cameras", "single_blobs", "single_labels",
             "camera_times_s", "notes")  # fmt: skip
    blobs = {
        "blobs": [_digest(blobs) for blobs in frame.blobs],
        "detected": [_digest(blobs) for blobs in frame.detected],
        "first_blobs": [blobs[:1] for blobs in frame.blobs],
    }
    return digests | blobs | {key: getattr(frame, key) for key in plain} | {"stamp_s": stamp_s}


def _take(path: Path) -> dict[str, Any]:
    take, summary = read_take_file(path), summarise(path)
    setup, notes, subjects = take.setup, take.notes, take.setup.subjects()
    summary_keys = ("complete", "frames", "duration_s", "created", "orphaned", "marker_set", "method", "database")
    setup_keys = ("settings", "database", "capture", "created", "software")
    notes_keys = ("name", "notes", "rating", "character", "played", "recorded")
    return {
        "complete": take.complete,
        "ended": take.ended,
        "faults": [[fault.offset, fault.size, fault.cut] for fault in take.faults],
        "chunks": [[int(chunk.kind), chunk.sequence, len(chunk.payload)] for chunk in take.chunks],
        "declared_frames": take.declared_frames,
        "frames": take.frame_count,
        "poses": len(take.poses),
        "recorded_poses": len(take.recorded_poses),
        "setup": {key: getattr(setup, key) for key in setup_keys}
        | {
            "subjects": [_subject(subject) for subject in subjects],
            "rig": _rig(setup.camera_rig()),
            "props": [_prop(prop) for prop in setup.carried_props()],
        },
        "notes": {key: getattr(notes, key) for key in notes_keys},
        "events": take.events,
        "gaps": [{"after": gap.after, "seconds": gap.seconds, "text": gap.text} for gap in take.gaps],
        "first_frame": _frame(*take.stamped_frames[0]),
        "last_frame": _frame(*take.stamped_frames[-1]),
        "frame_notes": {str(frame.number): frame.notes for frame in take.frames if frame.notes},
        "all_points_m": _digest(np.concatenate([frame.points_m for frame in take.frames])),
        "performers": [
            _performer(take, index, subject) for index, subject in enumerate(subjects if take.poses else ())
        ],
        "solved": [[solved.stamp_s, solved.solve_s, solved.waiting] for solved in take.poses[:1]],
        "summary": {key: getattr(summary, key) for key in summary_keys}
        | {"subject": "".join(summary.performers[:1]), "performers": summary.performers[1:]},
    }


def _database(path: Path) -> dict[str, Any]:
    database = open_database(path)
    turns = database.local_rotations(slice(None))
    whole = ("mean_rotations", "poses", "root_rotations", "root_positions_m")
    return {key: _digest(getattr(database, key)) for key in whole} | {
        "frames": database.frames,
        "fps": database.fps,
        "clips": [vars(clip) for clip in database.clips],
        "behaviours": database.behaviours,
        "source_rates": database.source_rates,
        "culled_frames": database.culled_frames,
        "identity_sha256": identity(database)["sha256"],
        "skeletons": [_skeleton(skeleton) for skeleton in database.skeletons],
        "first_pose": _digest(database.poses[0]),
        "last_pose": _digest(database.poses[-1]),
        "first_local_rotations": _digest(turns[0]),
        "last_local_rotations": _digest(turns[-1]),
        "first_root_m": database.root_positions_m[0],
        "last_root_m": database.root_positions_m[-1],
        "cells": None if database.cells is None else _digest(database.cells),
    }


def _marker_take(path: Path) -> dict[str, Any]:
    take = read_take(path)
    single = take.single
    return {
        "name": take.name,
        "fps": take.fps,
        "names": take.names,
        "frames": take.frames,
        "frame_numbers": _digest(take.frame_numbers),
        "times_s": _digest(take.times_s),
        "positions_m": _digest(take.positions_m),
        "first_m": take.positions_m[0],
        "last_m": take.positions_m[-1],
        "visible": take.visible.mean(),
        "single": single
        and {
            "rig": _rig(single.rig),
            "cameras": _digest(single.cameras),
            "points": _digest(single.points),
            "shown": (single.cameras >= 0).sum(),
            "shown_points": _digest(single.points[single.cameras >= 0]),
        },
    }


def _plan(path: Path) -> dict[str, Any]:
    plan = read_plan(path, {})
    takes = [
        {"name": take.name, "source": take.source, "take": take.take, "options": dict(take.options)}
        | {command: take.options_of(command) for command in ("track", "solve", "retarget")}
        for take in plan.takes
    ]
    return json.loads(json.dumps({"out": plan.out, "takes": takes}).replace(str(path.parent.resolve()), "<here>"))


READERS: dict[str, Callable[[Path], Any]] = {
    "*.perftake": _take,
    "*.pfdb": _database,
    "*.perfdb": _database,
    "*.npz": _marker_take,
    "*.c3d": _marker_take,
    "camera*.toml": lambda path: _rig(load_rig(path)),
    "bone-map*.toml": read_bone_map,
    "prop*.toml": lambda path: _prop(load_prop(path)),
    "marker-set*.toml": lambda path: _marker_set(load_marker_set(path)),
    "names.toml": load_names,
    "plan*.toml": _plan,
    "*.toml": lambda path: _subject(load_subject(path)),
}


def _check(found: Any, expected: Any, where: str) -> None:
    """Compare with what JSON keeps: numbers to rounding, tuples and arrays as lists, NaN as null."""
    found = found.tolist() if isinstance(found, np.ndarray | np.generic) else found
    found = found.text if isinstance(found, PoseNote) else found
    if isinstance(expected, dict):
        assert set(found) == set(expected), where
        for key, value in expected.items():
            _check(found[key], value, f"{where}/{key}")
    elif isinstance(expected, list):
        assert len(found) == len(expected), where
        for index, value in enumerate(expected):
            _check(found[index], value, f"{where}/{index}")
    elif isinstance(expected, float):
        assert found == pytest.approx(expected, rel=1e-9, abs=1e-12), where
    elif expected is None:
        assert found is None or math.isnan(found), where
    else:
        assert found == expected, where


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The old files, with those that are parts or copies of others."""
    folder = tmp_path_factory.mktemp("old") / "files"
    shutil.copytree(HERE / "files", folder)
    shutil.copyfile(folder / "motion.pfdb", folder / "motion.perfdb")
    whole = (folder / "one-and-sword.perftake").read_bytes()
    (folder / "cut-off.perftake").write_bytes(whole[: int(len(whole) * 0.6)])
    return folder


def test_every_file_has_its_facts(folder: Path) -> None:
    assert {path.name for path in folder.iterdir()} == set(EXPECTED)


@pytest.mark.parametrize("name", EXPECTED)
def test_opens_as_before(folder: Path, name: str) -> None:
    assert (folder / name).stat().st_size == EXPECTED[name]["bytes"]
    read = next(reader for pattern, reader in READERS.items() if Path(name).match(pattern))
    _check(read(folder / name), EXPECTED[name]["read"], name)
