"""VRM animation files (.vrma): binary glTF 2.0 with VRMC_vrm_animation 1.0.

Nodes are the humanoid's bones in the VRM T pose, without rotation or scale; all bones are animated by rotations, the
hips also by translations. glTF's axes are ours: x to the performer's left, y up, z forward, metres.

Specification: https://github.com/vrm-c/vrm-specification/tree/master/specification/VRMC_vrm_animation-1.0
"""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np

from ... import __version__
from ...body.calibration_poses import t_pose
from ...body.motion import Motion
from ...body.skeleton import forward_kinematics
from ...body.soles import sole_heights_m
from ...geometry import rotations as rot
from ...geometry.arrays import Array
from ...system.files import atomic_path
from ..vmc.humanoid import BONES, bone_poses

ENDING = ".vrma"

_EXTENSION = "VRMC_vrm_animation"
_FLOAT = 5126  # component type of 32-bit numbers


def write_vrma(motion: Motion, path: Path | str) -> None:
    """Write a motion of the standard skeleton as a VRM animation.

    Raises:
        FormatError: The file cannot be written.
        SkeletonError: Standard joints are missing.
    """
    poses = bone_poses(motion)
    bones = [name[:1].lower() + name[1:] for name in poses.names]
    above = [poses.names.index(parent) if parent else -1 for _, parent in BONES.values()]
    places = poses.positions_m[0].copy()
    posed = forward_kinematics(motion.skeleton, t_pose(motion.skeleton), np.zeros(3))
    places[0] = 0.0, -float(sole_heights_m(motion.skeleton, *posed).min()), 0.0  # hips above the floor
    nodes: list[dict[str, Any]] = [
        {"name": bone, "translation": place} for bone, place in zip(bones, places.tolist(), strict=True)
    ]
    for bone, parent in enumerate(above):
        if parent >= 0:
            nodes[parent].setdefault("children", []).append(bone)
    buffer = _Buffer()
    times = buffer.add(np.arange(motion.frames) / motion.fps, "SCALAR", bounded=True)
    paths = [(0, "translation", buffer.add(poses.positions_m[:, 0], "VEC3"))]
    turns = rot.continuous(poses.rotations)[..., [1, 2, 3, 0]]
    paths += [(bone, "rotation", buffer.add(turns[:, bone], "VEC4")) for bone in range(len(bones))]
    animation = {
        "name": motion.name,
        "channels": [
            {"sampler": sampler, "target": {"node": node, "path": kind}}
            for sampler, (node, kind, _) in enumerate(paths)
        ],
        "samplers": [{"input": times, "output": values, "interpolation": "LINEAR"} for _, _, values in paths],
    }
    humanoid = {"humanBones": {bone: {"node": node} for node, bone in enumerate(bones)}}
    document = {
        "asset": {"version": "2.0", "generator": f"perfanim {__version__}"},
        "extensionsUsed": [_EXTENSION],
        "extensions": {_EXTENSION: {"specVersion": "1.0", "humanoid": humanoid}},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": nodes,
        "animations": [animation],
        **buffer.tables(),
    }
    with atomic_path(path) as temporary:
        temporary.write_bytes(_glb(document, bytes(buffer.data)))


class _Buffer:
    """Binary data of a glTF file, and the tables that describe its arrays."""

    def __init__(self) -> None:
        self.data = bytearray()
        self._views: list[dict[str, Any]] = []
        self._accessors: list[dict[str, Any]] = []

    def add(self, values: Array, kind: str, bounded: bool = False) -> int:
        """Append an array (F,) or (F, n) as 32-bit numbers; return its accessor's index.

        Args:
            bounded: Store the smallest and largest value, which glTF requires for times.
        """
        stored = np.ascontiguousarray(values, dtype="<f4")
        table: dict[str, Any] = {
            "bufferView": len(self._views), "componentType": _FLOAT, "count": len(stored), "type": kind,
        }  # fmt: skip
        if bounded:
            table |= {"min": [float(stored.min())], "max": [float(stored.max())]}
        self._views.append({"buffer": 0, "byteOffset": len(self.data), "byteLength": stored.nbytes})
        self.data += stored.tobytes()
        self._accessors.append(table)
        return len(self._accessors) - 1

    def tables(self) -> dict[str, Any]:
        """Return the tables of the document that describe the arrays."""
        return {"buffers": [{"byteLength": len(self.data)}], "bufferViews": self._views, "accessors": self._accessors}


def _glb(document: dict[str, Any], data: bytes) -> bytes:
    """Return a binary glTF file: header, JSON chunk, binary chunk."""
    text = json.dumps(document, separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    chunks = b"".join(
        struct.pack("<I4s", len(content), kind) + content for kind, content in ((b"JSON", text), (b"BIN\0", data))
    )
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks
