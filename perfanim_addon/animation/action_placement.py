"""Placement of a new action: active action or NLA strip."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

import bpy
import numpy as np

from ...core.geometry.arrays import Array
from .channels import HAS_SLOTS, assign, channels_of, slot_of
from .keyframes import KeyBounds

BLEND_S = 0.25  # blend time of a layer at its start and end


class PlacementMode(Enum):
    """Destination of keyframes."""

    ACTION = "new active action"
    STRIP = "NLA strip above the present animation"
    LAYER = "NLA strip that blends in over the present animation and out again"


@dataclass(frozen=True)
class Placement:
    """Placement of keyframes on an armature.

    Args:
        only: names of the bones that get any; None for all.
        bounds: of the reduction; None for a key in every frame.
        marked: scene frames with keys of the type Jitter.
        doubtful: bone -> further scene frames with such keys, or with none.
        leave_out: none.
    """

    onto: PlacementMode = PlacementMode.ACTION
    only: Collection[str] | None = None
    bounds: KeyBounds | None = None
    marked: Collection[float] = ()
    doubtful: Mapping[str, Collection[float]] = field(default_factory=dict)
    leave_out: bool = False


def new_action(animation: bpy.types.AnimData, name: str, onto: PlacementMode) -> bpy.types.Action:
    """Return a new action without curves; push the active one down for a strip."""
    if onto is not PlacementMode.ACTION:
        _push_down(animation)
    action = bpy.data.actions.new(name)
    action.use_fake_user = True
    return action


def place_action(
    animation: bpy.types.AnimData, action: bpy.types.Action, frames: Array, onto: PlacementMode, blend: float
) -> None:
    """Make an action active, or add its strip.

    Args:
        frames: (F,) where its keys are.
        onto: as of `new_action`.
        blend: frames in which a strip blends in, and out.
    """
    if onto is PlacementMode.ACTION:
        assign(animation, action)
    else:
        _add_strip(animation, action, (float(frames[0]), float(frames[-1])), blend)


def fit_strips(animation: bpy.types.AnimData, action: bpy.types.Action, frames: Array) -> None:
    """Let the strips of an action show all its frames (F,) where they are keyed."""
    for strip in (each for track in animation.nla_tracks for each in track.strips if each.action == action):
        _fit(strip, (float(frames[0]), float(frames[-1])))


def _fit(strip: bpy.types.NlaStrip, frames: tuple[float, float]) -> None:
    strip.action_frame_start, strip.action_frame_end = frames
    strip.frame_start_ui = frames[0]


def _push_down(animation: bpy.types.AnimData) -> None:
    """Push the active action down to a strip, as Blender's Push Down does."""
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
    animation: bpy.types.AnimData, action: bpy.types.Action, frames: tuple[float, float], blend: float, slot: Any = None
) -> bpy.types.NlaStrip:
    """Add an action as a strip on a new top track; it blends in and out over `blend`.

    Where something lies below, it shows before and after the strip.
    """
    below = len(animation.nla_tracks) > 0
    track = animation.nla_tracks.new()
    track.name = action.name
    strip = track.strips.new(action.name, int(np.floor(frames[0])), action)
    if HAS_SLOTS:
        strip.action_slot = slot or action.slots[0]
    _fit(strip, frames)
    strip.blend_type, strip.extrapolation = "REPLACE", "NOTHING" if below else "HOLD"
    strip.use_auto_blend = False
    strip.blend_in = strip.blend_out = min(blend, (frames[1] - frames[0]) / 3.0)
    animation.use_nla = True
    return strip
