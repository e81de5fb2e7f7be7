"""Hand poses asked for during a capture: shown at once, and keyed at the end."""

from collections.abc import Sequence

import bpy

from ...core.geometry.arrays import Array
from ..animation.actions import scene_frames
from ..animation.hand_keys import BLEND_FRAMES, hand_turns, key_hands
from .write_take import RecordedPart


class HandCues:
    """Poses of hands, each with the time of the pose from which it is held."""

    def __init__(self) -> None:
        self._cues: list[tuple[float, str, str]] = []

    def add(self, time_s: float, name: str, sides: str) -> None:
        """Note that hands ("l", "r", "lr") hold a pose of `HAND_POSES` from a time of the capture on."""
        self._cues.append((time_s, name, sides))

    def key(self, armature_object: bpy.types.Object, parts: Sequence[RecordedPart]) -> None:
        """Key the poses in the recorded parts; one from before a part is there from its start on.

        Raises:
            CharacterError: The character's action cannot be edited, or it has no bones for fingers.
        """
        cues = [(time_s, hand_turns(armature_object, sides, name)) for time_s, name, sides in self._cues]
        for part in parts:
            first_s, last_s = part.poses[0].time_s, part.poses[-1].time_s
            at_start: dict[str, Array] = {}
            for time_s, turns in cues:
                if time_s <= first_s:
                    at_start |= turns
            later = [(time_s, turns) for time_s, turns in cues if first_s < time_s <= last_s]
            for time_s, turns in [(first_s, at_start), *later]:
                frame = float(scene_frames([first_s, time_s], bpy.context.scene, part.start_frame)[1])
                if turns:
                    key_hands(armature_object, turns, round(frame), BLEND_FRAMES)
