"""Operators that pose the fingers by presets, on keyed actions and during a capture."""

import bpy

from ...core.retarget.hand_poses import HAND_POSES
from ..animation.hand_keys import BLEND_FRAMES, hand_turns, key_hands
from ..capture.live_capture import running_capture
from ..panels.hands_panel import KEY as PANEL
from ..panels.hands_panel import SIDES
from ..preferences.property_kinds import choice, whole_number
from ..settings.capture_settings import settings
from .operator_bases import PanelOperator, UndoOperator, need

_POSES = tuple((name.upper(), name.capitalize(), "") for name in HAND_POSES)
_SIDES = (
    ("BOTH", "Both", "Both hands"),
    ("LEFT", "Left", "The character's left hand"),
    ("RIGHT", "Right", "The character's right hand"),
)


class PERFANIM_OT_pose_hands(UndoOperator, bpy.types.Operator):
    """From the playhead on, the fingers hold this pose; a take's own keys of the fingers are removed"""

    bl_label = "Pose Hands"
    panel = PANEL
    missing_input = need(lambda context: settings(context).armature, "Choose a character first")
    pose: choice("Pose", "Pose of the fingers", _POSES)
    side: choice("Side", "Hand to pose", _SIDES)
    blend_frames: whole_number("Blend", "Frames before the playhead in which the fingers move", BLEND_FRAMES, 1, 1000)

    def run(self, context: bpy.types.Context) -> str:
        character, frame = settings(context).armature, context.scene.frame_current
        turns = hand_turns(character, SIDES[self.side], self.pose.lower())
        action = key_hands(character, turns, frame, self.blend_frames)
        context.scene.frame_set(frame)
        return f"{self.pose.capitalize()} from frame {frame} on, in {action}"


class PERFANIM_OT_pose_hands_live(PanelOperator, bpy.types.Operator):
    """From now on, the fingers hold this pose; the recording gets keyframes"""

    bl_label = "Pose Hands"
    panel = PANEL
    needs_idle = False
    missing_input = need(lambda context: running_capture(), "No capture is running")
    pose: choice("Pose", "Pose of the fingers", _POSES)
    side: choice("Side", "Hand to pose", _SIDES)

    def run(self, context: bpy.types.Context) -> str:
        running_capture().pose_hands(self.pose.lower(), SIDES[self.side])
        return ""
