"""Placement of a new action: active action or NLA strip."""

import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

import bpy
import numpy as np

from ...core.geometry.arrays import Array
from ..blender_versions import assign, channels_of, detach_action, first_slot, set_slot, slot_of
from .keyframes import KeyBounds


class PlacementMode(Enum):
    """Where keyframes go."""

    ACTION = "new active action"
    STRIP = "NLA strip above the present animation"
    LAYER = "NLA strip that blends in over the present animation and out again"


@dataclass(frozen=True)
class Placement:
    """Where and how keyframes are placed on an armature."""

    onto: PlacementMode = PlacementMode.ACTION
    only: Collection[str] | None = None  # names of the bones that get keyframes; None for all
    bounds: KeyBounds | None = None  # None for a key in every frame
    marked: Collection[float] = ()  # scene frames with keys of the type Jitter
    doubtful: Mapping[str, Collection[float]] = field(default_factory=dict)  # the same, but for each bone separately
    leave_out: bool = False  # insert no keys in frames in which a bone is doubtful
    blend_s: float = 0.25  # blend time of a layer at its start and end, chosen by eye


def new_action(animation: bpy.types.AnimData, name: str, onto: PlacementMode) -> bpy.types.Action:
    """Return a new action without curves; for a strip, first push the active action down."""
    if onto is not PlacementMode.ACTION:
        _push_down(animation)
    # Blender would count on from the seconds of a take's name: 18.36.00, 18.36.001
    action = bpy.data.actions.new(re.sub(r"\b(\d\d)\.(\d\d)\.(\d\d)\b", r"\1:\2:\3", name))
    action.use_fake_user = True
    return action


def place_action(
    animation: bpy.types.AnimData, action: bpy.types.Action, frames: Array, onto: PlacementMode, blend: float
) -> None:
    """Make an action with keys in frames (F,) active, or add its strip, which blends in and out over `blend` frames."""
    if onto is PlacementMode.ACTION:
        assign(animation, action)
    else:
        _add_strip(animation, action, (float(frames[0]), float(frames[-1])), blend)


def fit_strips(animation: bpy.types.AnimData, action: bpy.types.Action, frames: Array) -> None:
    """Fit the strips of an action to its keyed frames (F,)."""
    for strip in (each for track in animation.nla_tracks for each in track.strips if each.action == action):
        _fit(strip, (float(frames[0]), float(frames[-1])))


def _fit(strip: bpy.types.NlaStrip, frames: tuple[float, float]) -> None:
    strip.action_frame_start, strip.action_frame_end = frames
    strip.frame_start_ui = frames[0]


def _push_down(animation: bpy.types.AnimData) -> None:
    """Push the active action down to a strip, as Blender's Push Down does."""
    action, slot = animation.action, slot_of(animation)
    if action is not None and any(channels_of(action, slot)):
        strip = _add_strip(animation, action, tuple(action.frame_range), 0.0, slot)
        strip.blend_type, strip.extrapolation = animation.action_blend_type, animation.action_extrapolation
    detach_action(animation)


def _add_strip(
    animation: bpy.types.AnimData, action: bpy.types.Action, frames: tuple[float, float], blend: float, slot: Any = None
) -> bpy.types.NlaStrip:
    """Add an action as a strip on a new top track; before and after the strip, the tracks below show."""
    below = len(animation.nla_tracks) > 0
    track = animation.nla_tracks.new()
    track.name = action.name
    strip = track.strips.new(action.name, int(np.floor(frames[0])), action)
    set_slot(strip, slot or first_slot(action))
    _fit(strip, frames)
    strip.blend_type, strip.extrapolation = "REPLACE", "NOTHING" if below else "HOLD"
    strip.use_auto_blend = False
    strip.blend_in = strip.blend_out = min(blend, (frames[1] - frames[0]) / 3.0)
    animation.use_nla = True
    return strip
