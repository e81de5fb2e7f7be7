"""Hand poses asked for during a capture: shown at once, and keyed at the end."""

from collections.abc import Mapping, Sequence

import bpy

from ...core.geometry.arrays import Array
from ..animation.actions import scene_frames
from ..animation.hand_keys import BLEND_FRAMES, key_hands
from .write_take import RecordedPart


class HandCues:
    """Rotations of finger bones, each with the time of the pose from which they are held."""

    def __init__(self) -> None:
        self._cues: list[tuple[float, Mapping[str, Array]]] = []

    def add(self, time_s: float, turns: Mapping[str, Array]) -> None:
        """Note that bones hold rotations (4,) from a time of the capture on."""
        self._cues.append((time_s, turns))

    def key(self, armature_object: bpy.types.Object, parts: Sequence[RecordedPart]) -> None:
        """Key the poses in the recorded parts; one from before a part is there from its start on.

        Raises:
            CharacterError: The character's action cannot be edited.
        """
        for part in parts:
            first_s, last_s = part.poses[0].time_s, part.poses[-1].time_s
            at_start: dict[str, Array] = {}
            for time_s, turns in self._cues:
                if time_s <= first_s:
                    at_start |= turns
            later = [(time_s, turns) for time_s, turns in self._cues if first_s < time_s <= last_s]
            for time_s, turns in [(first_s, at_start), *later]:
                frame = float(scene_frames([first_s, time_s], bpy.context.scene, part.start_frame)[1])
                if turns:
                    key_hands(armature_object, turns, round(frame), BLEND_FRAMES)
