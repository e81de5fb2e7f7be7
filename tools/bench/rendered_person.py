"""A person without markers, rendered by Blender in a lit room and filmed by two cameras: from pictures to motion."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from perfanim.core.api.solving import solve
from perfanim.core.api.tracking import TrackRequest, track
from perfanim.core.body.body_size import standing_root_m
from perfanim.core.body.motion import Motion, resampled, sliced
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.formats.markers.marker_files import read_take
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.arrays import Array
from perfanim.core.geometry.camera import Camera, CameraRig
from perfanim.core.simulate.studio.studio_rig import looking_at
from perfanim.core.vision.people.network_file import body_network_file

from .run import Run

JOINTS = ("humerus", "radius", "wrist", "femur", "tibia", "foot")  # of each side


@dataclass(frozen=True)
class RoomSettings:
    """The take, the cameras and the room."""

    take: str = "16/16_17.amc"  # a walk with a left turn, by a person who is not in the built-in motion
    seconds: float = 3.0
    fps: float = 15.0
    size: tuple[int, int] = (640, 480)
    focal: float = 0.8  # focal length in units of the image's width
    far_m: float = 4.2  # distance of the cameras from the middle of the room
    angles_deg: tuple[float, float] = (-45.0, 45.0)  # of the cameras, about the vertical
    heights_m: tuple[float, float] = (1.3, 1.6)
    room_m: float = 5.5  # distance of the walls from the middle
    samples: int = 2  # of a pixel
    bounces: int = 1  # of light: more take minutes and show the network nothing
    lamp_w: float = 700.0


ROOM = RoomSettings()


def rendered_person(run: Run) -> dict[str, Any]:
    """Film a walk, find the person, solve, and compare with the walk.

    Returns:
        rows (joint; median, and 90th percentile of the distance, mm), median_mm and p90_mm over all joints, and
        found (share of the pictures' points that are located).
    """
    motion = filmed_motion(run.data / "cmu", ROOM.seconds)
    found = distances(motion, two_cameras(), run.out / "rendered-person")
    return run.write("rendered-person", found, {"": found["rows"]})


def filmed_motion(cmu: Path, seconds: float) -> Motion:
    """Return the take's motion at the films' rate, in the middle of the room."""
    motion = resampled(read_motion(cmu / ROOM.take), ROOM.fps)
    return in_the_middle(sliced(motion, 0, min(motion.frames, round(seconds * ROOM.fps))))


def in_the_middle(motion: Motion) -> Motion:
    """Return the motion in the middle of the room, on its floor."""
    joints_m = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)[0]
    middle = 0.5 * (joints_m.min(axis=(0, 1)) + joints_m.max(axis=(0, 1)))
    middle[1] = joints_m[..., 1].min() - 0.02  # thickness of the soles below the toes
    return replace(motion, root_positions_m=motion.root_positions_m - middle)


def two_cameras(far_m: float = ROOM.far_m) -> CameraRig:
    """Return two cameras a right angle apart that look at the middle of the room from this distance."""
    width, height = ROOM.size
    focal = ROOM.focal * width
    matrix = np.array([[focal, 0.0, 0.5 * (width - 1)], [0.0, focal, 0.5 * (height - 1)], [0.0, 0.0, 1.0]])
    cameras = []
    for name, angle, high_m in zip(("left", "right"), np.radians(ROOM.angles_deg), ROOM.heights_m, strict=True):
        place = np.array([far_m * np.sin(angle), high_m, far_m * np.cos(angle)])
        rotation = looking_at(place, np.array([0.0, 0.9, 0.0]))
        cameras.append(Camera(name, ROOM.size, matrix, np.zeros(5), rotation, -rotation @ place))
    return CameraRig(tuple(cameras))


def distances(motion: Motion, rig: CameraRig, folder: Path) -> dict[str, Any]:
    """Return the figures of `rendered_person` for films of a motion, which are written to a folder."""
    from .rendered_room import render  # needs bpy

    render(motion, rig, folder)
    out = folder / "take.take.npz"
    sources = tuple(str(folder / camera.name) for camera in rig.cameras)
    told = track(TrackRequest(rig, sources, str(out), people=str(body_network_file()), fps=motion.fps))
    take = read_take(out)
    solved = solve(take).motion
    frames = np.searchsorted(np.arange(motion.frames) / motion.fps + 1e-6, take.times_s)
    own_m = joints_of(solved)
    true_m = joints_of(motion)[np.clip(frames, 0, motion.frames - 1)[: len(own_m)]]
    away_mm = 1e3 * np.linalg.norm(own_m - true_m, axis=-1)
    rows = [
        {
            "joint": name,
            "median_mm": round(float(np.median(each)), 1),
            "p90_mm": round(float(np.percentile(each, 90)), 1),
        }
        for name, each in zip([side + name for name in JOINTS for side in "lr"], away_mm.T, strict=True)
    ]
    return {
        "rows": rows,
        "median_mm": round(float(np.median(away_mm)), 1),
        "p90_mm": round(float(np.percentile(away_mm, 90.0)), 1),
        "found": round(float(told["visible_fraction"]), 3),
        "warnings": told["warnings"],
    }


def joints_of(motion: Motion) -> Array:
    """Return the places (F, J, 3) of `JOINTS` of the left and the right side."""
    joints_m = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)[0]
    return joints_m[:, [motion.skeleton.index(side + name) for name in JOINTS for side in "lr"]]


def skin(motion: Motion, vertices_m: Array, weights: Array) -> Iterator[Array]:
    """Yield a body's vertices (V, 3) in each frame, from those in the rest pose (linear blend skinning)."""
    heads_m = motion.skeleton.rest_positions_m + standing_root_m(motion.skeleton)
    joints_m, turned = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)
    for places_m, rotations in zip(joints_m, turned, strict=True):
        matrices = rot.to_matrix(rotations)
        shift = places_m - np.einsum("jab,jb->ja", matrices, heads_m)
        moved = np.einsum("vj,jab,vb->va", weights, matrices, vertices_m)
        yield moved + weights @ shift
