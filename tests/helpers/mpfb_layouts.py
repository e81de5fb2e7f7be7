"""Bone layouts of MPFB: characters without a mesh."""

import json
from pathlib import Path

import numpy as np
from perfanim.core.retarget.armature_rest import ArmatureRest


def layout(path: Path) -> ArmatureRest:
    """A bone layout of MPFB as it would be on its default body."""
    read = json.loads(path.read_text())
    bones = read.get("bones", read)
    order: list[str] = []

    def add(name: str) -> None:
        if name not in order:
            if bones[name].get("parent"):
                add(bones[name]["parent"])
            order.append(name)

    for name in bones:
        add(name)
    place = {name: index for index, name in enumerate(order)}
    ends = [np.array([bones[n][end].get("default_position", (0, 0, 0)) for n in order]) for end in ("head", "tail")]
    parents = np.array([place[bones[n]["parent"]] if bones[n].get("parent") else -1 for n in order])
    yes = np.ones(len(order), dtype=bool)
    return ArmatureRest(
        tuple(order), parents, *ends, np.tile(np.eye(3), (len(order), 1, 1)), yes, yes, yes, np.ones(len(order)), ~yes
    )


def save_layout(path: Path, target: Path) -> None:
    """Write a layout as an armature to a .blend; what is open is lost."""
    import bpy

    rest = layout(path)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    obj = bpy.data.objects.new(path.stem, bpy.data.armatures.new(path.stem))
    bpy.context.scene.collection.objects.link(obj)
    bpy.context.view_layer.objects.active = obj
    bpy.ops.object.mode_set(mode="EDIT")
    for name, parent, head, tail in zip(rest.names, rest.parents, rest.heads, rest.tails, strict=True):
        bone = obj.data.edit_bones.new(name)
        bone.head, bone.tail = head, tail
        if parent >= 0:
            bone.parent = obj.data.edit_bones[rest.names[parent]]
    bpy.ops.object.mode_set(mode="OBJECT")
    bpy.ops.wm.save_as_mainfile(filepath=str(target))
