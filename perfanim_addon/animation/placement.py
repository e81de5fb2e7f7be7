"""Where a new action goes: in place of what is played, or as an NLA strip above it."""

from collections.abc import Collection
from dataclasses import dataclass
from enum import Enum
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from .channels import HAS_SLOTS, assign, channels_of, slot_of
from .keyframes import KeyBounds

Array = NDArray[np.float64]

BLEND_S = 0.25  # in which a layer takes over from what is below it, and hands back


class Onto(Enum):
    """Where the keyframes go."""

    ACTION = "a new action, which the armature plays from then on"
    STRIP = "an NLA strip above what the armature plays"
    LAYER = "an NLA strip that blends in over what the armature plays, and out again"


@dataclass(frozen=True)
class Placement:
    """How keyframes are put on an armature.

    Args:
        onto: where they go.
        only: names of the bones that get any; None for all.
        bounds: of the reduction; None for a key in every frame.
    """

    onto: Onto = Onto.ACTION
    only: Collection[str] | None = None
    bounds: KeyBounds | None = None


def new_action(animation: bpy.types.AnimData, name: str, onto: Onto) -> bpy.types.Action:
    """Return a new action without curves, for which what is played makes room."""
    if onto is not Onto.ACTION:
        _push_down(animation)
    action = bpy.data.actions.new(name)
    action.use_fake_user = True
    return action


def put(animation: bpy.types.AnimData, action: bpy.types.Action, frames: Array, onto: Onto, blend: float) -> None:
    """Let an action be played.

    Args:
        frames: (F,) where its keys are.
        onto: as of `new_action`.
        blend: frames in which a strip blends in, and out.
    """
    if onto is Onto.ACTION:
        assign(animation, action)
    else:
        _add_strip(animation, action, (float(frames[0]), float(frames[-1])), blend)


def _push_down(animation: bpy.types.AnimData) -> None:
    """Make the action that is played a strip of its own, as Blender's Push Down does, below what follows."""
    action = animation.action
    if action is None:
        return
    first, last = (float(frame) for frame in action.frame_range)
    if any(channels_of(action, slot_of(animation))):
        strip = _add_strip(animation, action, (first, last), 0.0, slot_of(animation))
        strip.blend_type, strip.extrapolation = animation.action_blend_type, animation.action_extrapolation
    action.use_fake_user = True
    animation.action = None


def _add_strip(
    animation: bpy.types.AnimData,
    action: bpy.types.Action,
    frames: tuple[float, float],
    blend: float,
    slot: Any = None,
) -> bpy.types.NlaStrip:
    """Add an action as a strip on a new track above all others, where its keys are; so long it blends in and out.

    Where something lies below, it shows before and after the strip.
    """
    below = len(animation.nla_tracks) > 0
    track = animation.nla_tracks.new()
    track.name = action.name
    strip = track.strips.new(action.name, int(np.floor(frames[0])), action)
    if HAS_SLOTS:
        strip.action_slot = slot or action.slots[0]
    strip.action_frame_start, strip.action_frame_end = frames
    strip.frame_start_ui = frames[0]
    strip.blend_type, strip.extrapolation = "REPLACE", "NOTHING" if below else "HOLD"
    strip.use_auto_blend = False
    strip.blend_in = strip.blend_out = min(blend, (frames[1] - frames[0]) / 3.0)
    animation.use_nla = True
    return strip
