"""Driver that poses an armature, fast enough for every tick of a live capture."""

from collections.abc import Collection, Mapping

import numpy as np
from numpy.typing import ArrayLike

from ...core.body.skeleton import Skeleton
from ...core.geometry.arrays import Array, IntArray
from ...core.retarget.retargeter import apply_plan
from ..animation.quaternion_curves import keep_in_quaternions
from ..character.armature_reading import clear_offsets, delta_transforms
from ..character.bone_map_settings import stored_adjustments
from ..character.create_character import find_armature
from ..character.part_bones import PARTS, bones_of_parts
from ..character.retarget_plans import plan_for

_QUATERNION_MODE = 0  # PoseBone.rotation_mode "QUATERNION" in foreach_get


class ArmatureDriver:
    """Writes poses to the pose bones of one armature object.

    Only the object's name is kept: undo, redo and loading a file replace Blender's data, so it is looked up for every
    pose.

    Args:
        object_name: Name of the armature object; its bones are switched to quaternions.
        parts: Body parts to move (see `PARTS`).

    Raises:
        CharacterError: The armature is missing or cannot be driven.
    """

    def __init__(self, object_name: str, skeleton: Skeleton, parts: Collection[str] = PARTS) -> None:
        self.object_name = object_name
        self._skeleton = skeleton
        self._parts = parts
        self._last: tuple[ArrayLike, ArrayLike] | None = None
        self._held: dict[str, Array] = {}
        self.bind()

    def bind(self) -> None:
        """Read the armature's rest pose again, for example after an edit; errors are those of the constructor."""
        armature_object = find_armature(self.object_name)
        self.plan = plan_for(armature_object, self._skeleton)
        self._adjusted = stored_adjustments(armature_object)
        bones = armature_object.pose.bones
        places = {bone.name: index for index, bone in enumerate(bones)}
        self.only = bones_of_parts(armature_object, self.plan, self._parts)
        only = {*self.plan.bones, *self.plan.located} if self.only is None else self.only
        self._turned = np.flatnonzero([name in only for name in self.plan.bones])
        self._located = [(name, place) for place, name in enumerate(self.plan.located) if name in only]
        self._names = [self.plan.bones[place] for place in self._turned]
        keep_in_quaternions(armature_object, self._names)  # otherwise their existing animation would stop
        clear_offsets(armature_object, self._names, (name for name, _ in self._located))
        self._order: IntArray = np.array([places[name] for name in self._names], dtype=np.int64)
        self._quaternions = np.zeros((len(bones), 4), dtype=np.float32)
        self._modes = np.zeros(len(bones), dtype=np.int32)

    def hold(self, turns: Mapping[str, Array]) -> None:
        """Keep bones in rotations (4,) relative to rest from now on, whatever the poses say."""
        self._held |= turns
        bones = find_armature(self.object_name).pose.bones
        for name in turns:
            bones[name].rotation_mode = "QUATERNION"

    def apply(self, rotations: ArrayLike, root_position_m: ArrayLike) -> None:
        """Pose the armature.

        Args:
            rotations: Parent-from-joint quaternions (J, 4) relative to the rest pose.
            root_position_m: Root (3,) in the capture space.

        Raises:
            CharacterError: The armature is gone or has lost bones.
        """
        self._last = rotations, root_position_m
        armature_object = find_armature(self.object_name)
        bones = armature_object.pose.bones
        if len(bones) != len(self._quaternions) or stored_adjustments(armature_object) != self._adjusted:
            self.bind()
        bones.foreach_get("rotation_mode", self._modes)
        if np.any(self._modes[self._order] != _QUATERNION_MODE):
            for name in self._names:
                bones[name].rotation_mode = "QUATERNION"
        flat = self._quaternions.reshape(-1)
        if len(bones) > len(self._order):  # other bones of the rig keep their pose
            bones.foreach_get("rotation_quaternion", flat)
        pose = apply_plan(self.plan, rotations, root_position_m)
        self._quaternions[self._order] = pose.rotations[self._turned]
        for name, turn in self._held.items():
            self._quaternions[bones.find(name)] = turn
        bones.foreach_set("rotation_quaternion", flat)
        if pose.object_rotation is not None and pose.object_location is not None and self.only is None:
            turn, way = delta_transforms(armature_object, pose.object_rotation, pose.object_location)
            armature_object.delta_rotation_quaternion, armature_object.delta_location = turn, way
        # an ordinary assignment comes last: unlike foreach_set, it makes Blender evaluate and draw the pose
        for name, place in self._located:
            bones[name].location = pose.locations[place]
        if not self._located and self._names:
            bones[self._names[0]].rotation_quaternion = self._quaternions[self._order[0]]

    def apply_again(self) -> None:
        """Apply the last pose again after an animation has changed it; errors are those of `apply`."""
        if self._last is not None:
            self.apply(*self._last)
