"""Characters in binary glTF, whose nodes place, turn and scale them in several ways."""

import json
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

# joint -> parent and place in metres, y up
_JOINTS = {
    "Hips": ("", (0.0, 0.95, 0.0)),
    "Spine": ("Hips", (0.0, 1.07, 0.0)),
    "Spine1": ("Spine", (0.0, 1.2, 0.0)),
    "Spine2": ("Spine1", (0.0, 1.32, 0.0)),
    "Neck": ("Spine2", (0.0, 1.47, 0.0)),
    "Head": ("Neck", (0.0, 1.56, 0.02)),
} | {
    f"{side}{name}": (f"{side}{parent}" if parent not in ("Hips", "Spine2") else parent, (sign * x, y, z))
    for side, sign in (("Left", 1.0), ("Right", -1.0))
    for name, parent, x, y, z in (
        ("Shoulder", "Spine2", 0.05, 1.42, 0.0),
        ("Arm", "Shoulder", 0.18, 1.42, 0.0),
        ("ForeArm", "Arm", 0.45, 1.42, 0.0),
        ("Hand", "ForeArm", 0.7, 1.42, 0.0),
        ("UpLeg", "Hips", 0.09, 0.9, 0.0),
        ("Leg", "UpLeg", 0.09, 0.49, 0.0),
        ("Foot", "Leg", 0.09, 0.08, 0.0),
        ("ToeBase", "Foot", 0.09, 0.02, 0.13),
    )
}
_FLOAT, _SHORT = 5126, 5123
_QUARTER = (-(0.5**0.5), 0.0, 0.0, 0.5**0.5)  # about x, as nodes that bring z up to y up
_TURN = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


def write_character(path: Path, scales: Mapping[str, float], turned: bool = False, arms_down: bool = False) -> None:
    """Write a character of 1.56 m whose nodes show it standing in a T pose.

    Args:
        scales: Scale of nodes, joints or "Armature"; joints below are as much further away.
        turned: The armature's node is turned by a quarter.
        arms_down: The nodes pose the upper arms, which the meshes' matrices do not.
    """
    names = list(_JOINTS)
    shown = dict.fromkeys(("", *names), float(scales.get("Armature", 1.0)))
    nodes: list[dict[str, Any]] = [{"name": "Armature", "children": [2], "scale": [shown[""]] * 3}]
    nodes += [{"name": "Body", "mesh": 0, "skin": 0}]
    if turned:
        nodes[0]["rotation"] = _QUARTER
    for name, (parent, place) in _JOINTS.items():
        step = (np.subtract(place, _JOINTS[parent][1]) if parent else np.array(place)) / shown[parent]
        shown[name] = shown[parent] * scales.get(name, 1.0)
        node: dict[str, Any] = {"name": f"mixamorig:{name}", "scale": [scales.get(name, 1.0)] * 3}
        node["translation"] = (step @ _TURN if turned else step).tolist()
        node["children"] = [2 + names.index(child) for child in names if _JOINTS[child][0] == name]
        if arms_down and name in ("LeftArm", "RightArm"):
            node["rotation"] = [0.0, 0.0, -0.5 if name == "LeftArm" else 0.5, 0.75**0.5]
        nodes.append(node if node["children"] else {key: node[key] for key in node if key != "children"})
    places = np.array([place for _, place in _JOINTS.values()])
    binds = np.tile(np.eye(4), (len(names), 1, 1))
    for bind, place, name in zip(binds, places, names, strict=True):
        world = shown[name] * (_TURN if turned else np.eye(3))
        bind[:3, :3] = np.linalg.inv(world)
        bind[:3, 3] = -bind[:3, :3] @ place
    joints = np.zeros((len(names), 4), dtype="<u2")
    joints[:, 0] = np.arange(len(names))
    weights = np.tile(np.array([1.0, 0.0, 0.0, 0.0], dtype="<f4"), (len(names), 1))
    faces = np.array([(i, i + 1, i + 2) for i in range(len(names) - 2)], dtype="<u2").ravel()
    arrays = [places.astype("<f4"), joints, weights, faces, np.swapaxes(binds, 1, 2).reshape(-1, 16).astype("<f4")]
    kinds = ["VEC3", "VEC4", "VEC4", "SCALAR", "MAT4"]
    _write(path, nodes, arrays, kinds)


def _write(path: Path, nodes: list[dict[str, Any]], arrays: list[np.ndarray], kinds: list[str]) -> None:
    data, views, accessors = b"", [], []
    for number, (array, kind) in enumerate(zip(arrays, kinds, strict=True)):
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": array.nbytes})
        accessor = {"bufferView": number, "count": len(array), "type": kind}
        accessor["componentType"] = _FLOAT if array.dtype.kind == "f" else _SHORT
        accessors.append(accessor)
        data += array.tobytes() + bytes(-array.nbytes % 4)
    accessors[0] |= {"min": arrays[0].min(axis=0).tolist(), "max": arrays[0].max(axis=0).tolist()}
    primitive = {"attributes": {"POSITION": 0, "JOINTS_0": 1, "WEIGHTS_0": 2}, "indices": 3}
    content = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0, 1]}],
        "nodes": nodes,
        "meshes": [{"primitives": [primitive]}],
        "skins": [{"inverseBindMatrices": 4, "joints": list(range(2, len(nodes))), "skeleton": 0}],
        "buffers": [{"byteLength": len(data)}],
        "bufferViews": views,
        "accessors": accessors,
    }
    text = json.dumps(content).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
    path.write_bytes(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks)
