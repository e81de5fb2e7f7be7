"""Actions: recorded poses as keyframes, on every supported Blender (channels on the action up to 4.3, slots from 4.4).

The one module that knows how actions are built inside: `Action.fcurves` is gone in Blender 5.0, slots came in 4.4.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass
from enum import Enum
from typing import Any

import bpy
import numpy as np
from mathutils import Euler, Quaternion
from numpy.typing import ArrayLike, NDArray

from ..core import rotations as rot
from ..core.errors import CharacterError
from ..core.key_reduction import location_keys, rotation_keys, slopes
from ..core.skeleton import Skeleton
from .character import find_armature
from .posing import Posing, posing_of
from .retarget_rig import clear_offsets, delta_transforms

Array = NDArray[np.float64]

HAS_SLOTS = bpy.app.version >= (4, 4, 0)
BLEND_S = 0.25  # in which a layer takes over from what is below it, and hands back
_OBJECT_GROUP = "Object Transforms"  # as Blender calls it
_LINEAR = 1  # Keyframe.interpolation "LINEAR" as foreach_set takes it
_ALIGNED = 3  # Keyframe.handle_left_type "ALIGNED" likewise
_LINEAR_ROTATION_FRAMES = 2.0  # mean key distance up to which straight lines between keys show no corners


class Onto(Enum):
    """Where the keyframes go."""

    ACTION = "a new action, which the armature plays from then on"
    STRIP = "an NLA strip above what the armature plays"
    LAYER = "an NLA strip that blends in over what the armature plays, and out again"


@dataclass(frozen=True)
class KeyBounds:
    """How far curves with fewer keys may stray from what was recorded, in every recorded frame.

    Args:
        rotation_deg: of each bone, relative to its parent.
        location_mm: of each bone that is moved, in the scene.
    """

    rotation_deg: float
    location_mm: float


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


def scene_frames(times_s: ArrayLike, scene: bpy.types.Scene, start_frame: float = 1.0) -> Array:
    """Return scene frames (fractions allowed) of times (F,) in seconds: the first time falls on `start_frame`."""
    times = np.asarray(times_s, dtype=np.float64)
    return start_frame + (times - times[0]) * scene_fps(scene) if len(times) else times


def scene_fps(scene: bpy.types.Scene) -> float:
    """Return the scene's frames per second."""
    return float(scene.render.fps) / float(scene.render.fps_base)


def write_action(
    object_name: str,
    frames: ArrayLike,
    rotations: ArrayLike,
    root_positions_m: ArrayLike,
    skeleton: Skeleton,
    *,
    name: str = "Capture",
    placement: Placement = Placement(),
) -> str:
    """Write poses as a new action of an armature; the action that was there is kept in the file.

    Args:
        object_name: an armature object, driven as `posing_of` tells.
        frames: (F,) scene frame of each pose, strictly increasing, fractions allowed (see `scene_frames`).
        rotations: (F, J, 4) parent-from-joint quaternions relative to rest.
        root_positions_m: (F, 3) root in product space.
        skeleton: the skeleton that the poses are relative to.
        name: wished name of the action.
        placement: where it goes, which bones it moves, how many keys it has.

    Returns:
        The action's name (Blender may append ".001").

    Raises:
        CharacterError: no such armature, one that cannot be driven, no poses, arrays that do not belong together, or
            none of the bones is to be moved.
    """
    armature_object = find_armature(object_name)
    at = np.asarray(frames, dtype=np.float64)
    q = np.asarray(rotations, dtype=np.float64)
    positions = np.asarray(root_positions_m, dtype=np.float64)
    _check(at, q, positions, skeleton)
    return write_posing(
        armature_object, at, q, positions, posing_of(armature_object, skeleton), name=name, placement=placement
    )


def write_posing(
    armature_object: bpy.types.Object,
    frames: Array,
    rotations: Array,
    root_positions_m: Array,
    posing: Posing,
    *,
    name: str,
    placement: Placement = Placement(),
) -> str:
    """Write poses through a given posing as a new action; arguments and result otherwise as of `write_action`."""
    animation = armature_object.animation_data or armature_object.animation_data_create()
    if animation.use_tweak_mode:
        advice = "leave tweak mode (Tab in the NLA editor)"
        raise CharacterError("a strip of it is being edited", where=armature_object.name, advice=advice)
    turned = _moved(posing.bones, placement.only)
    moved = _moved(posing.located, placement.only)
    if not turned and not moved:
        advice = "select bones of the map in Pose Mode, or write all"
        raise CharacterError("none of the bones that would move is selected", where=armature_object.name, advice=advice)
    pose = posing.pose(rotations, root_positions_m)
    keep_in_quaternions(armature_object, turned)
    clear_offsets(armature_object, turned, moved)
    for bone_name in turned:
        armature_object.pose.bones[bone_name].rotation_mode = "QUATERNION"
    if placement.onto is not Onto.ACTION:
        _push_down(animation)
    quaternions = rot.continuous(pose.rotations)
    signs = np.ones((2, len(turned)))  # at the beginning and the end
    if placement.onto is Onto.LAYER:  # q and -q are the same, but a blend between one and the other goes round
        for row, end in enumerate((0, -1)):
            below = _quaternions_at(armature_object, list(turned), float(frames[end]))
            facing = np.sum(below * quaternions[end, list(turned.values())], axis=-1)
            signs[row] = np.where(facing < 0.0, -1.0, 1.0)
    action = bpy.data.actions.new(name)
    action.use_fake_user = True
    writer = _Writer(armature_object, action, frames, placement.bounds)
    for (bone_name, place), ends in zip(turned.items(), signs.T, strict=True):
        writer.rotate(_bone_path(bone_name, "rotation_quaternion"), bone_name, quaternions[:, place], ends)
    for bone_name, place in moved.items():
        writer.move(_bone_path(bone_name, "location"), bone_name, pose.locations[:, place])
    if pose.object_rotation is not None and pose.object_location is not None and placement.only is None:
        turns, ways = delta_transforms(armature_object, pose.object_rotation, pose.object_location)
        writer.rotate("delta_rotation_quaternion", _OBJECT_GROUP, rot.continuous(turns))
        writer.move("delta_location", _OBJECT_GROUP, ways)
    if placement.onto is Onto.ACTION:
        _assign(animation, action)
    else:
        blend = BLEND_S * scene_fps(bpy.context.scene) if placement.onto is Onto.LAYER else 0.0
        _add_strip(animation, action, (float(frames[0]), float(frames[-1])), blend)
    return str(action.name)


def write_object_action(
    target: bpy.types.Object, frames: Array, rotations: Array, locations: Array, *, name: str, placement: Placement
) -> str:
    """Write how an object moves as a new action of it; return the action's name.

    Args:
        target: is switched to quaternions.
        frames: (F,) scene frames, strictly increasing.
        rotations, locations: (F, 4), (F, 3) in its parent's space.
        name: wished name of the action.
        placement: where it goes and how many keys it has; a strip of an object does not blend.
    """
    animation = target.animation_data or target.animation_data_create()
    target.rotation_mode = "QUATERNION"
    if placement.onto is not Onto.ACTION:
        _push_down(animation)
    action = bpy.data.actions.new(name)
    action.use_fake_user = True
    writer = _Writer(target, action, frames, placement.bounds)
    writer.rotate("rotation_quaternion", _OBJECT_GROUP, rot.continuous(rotations))
    writer.move("location", _OBJECT_GROUP, locations)
    if placement.onto is Onto.ACTION:
        _assign(animation, action)
    else:
        _add_strip(animation, action, (float(frames[0]), float(frames[-1])), 0.0)
    return str(action.name)


def _moved(bones: tuple[str, ...], only: Collection[str] | None) -> dict[str, int]:
    """Return the bones to be written, each with its place among all."""
    return {name: place for place, name in enumerate(bones) if only is None or name in only}


class _Writer:
    """Adds curves to a new action of an armature.

    Args:
        frames: (F,) scene frame of each value.
        bounds: of the reduction, None for a key in every frame.
    """

    def __init__(
        self, armature_object: bpy.types.Object, action: bpy.types.Action, frames: Array, bounds: KeyBounds | None
    ) -> None:
        self._channels = _new_channels(action, armature_object)
        self._frames = frames
        self._bounds = bounds
        self._straight = len(frames) < 2 or float(np.mean(np.diff(frames))) <= _LINEAR_ROTATION_FRAMES
        scale = float(np.mean(np.abs(armature_object.matrix_world.to_scale())))
        self._unit_mm = 1000.0 * bpy.context.scene.unit_settings.scale_length * max(scale, 1e-9)

    def rotate(self, path: str, group: str, quaternions: Array, signs: ArrayLike = (1.0, 1.0)) -> None:
        """Add the four curves of a rotation (F, 4), with these signs at its beginning and its end.

        Where they differ, the sign changes half way, between two keys that nothing is drawn between.
        """
        first, last = np.asarray(signs, dtype=np.float64)
        bounds, half = self._bounds, len(quaternions) // 2 if first != last else 0
        pieces = [slice(0, half), slice(half, None)] if half else [slice(None)]
        signed = np.concatenate((first * quaternions[:half], last * quaternions[half:]))
        steep = np.concatenate([slopes(self._frames[piece], signed[piece]) for piece in pieces])
        keys = None
        if bounds:
            bound = np.radians(bounds.rotation_deg)
            found = [rotation_keys(self._frames[piece], signed[piece], bound) for piece in pieces]
            keys = np.concatenate((found[0], *(half + more for more in found[1:])))
        for curve in self._add(path, group, signed, steep, keys):
            if half:
                held = half if keys is None else int(np.searchsorted(keys, half))
                curve.keyframe_points[held - 1].interpolation = "CONSTANT"

    def move(self, path: str, group: str, locations: Array) -> None:
        """Add the three curves of a location (F, 3) in the armature's unit."""
        bounds = self._bounds
        keys = location_keys(self._frames, locations, bounds.location_mm / self._unit_mm) if bounds else None
        self._add(path, group, locations, slopes(self._frames, locations), keys)

    def _add(
        self, path: str, group: str, values: Array, steep: Array, keys: NDArray[np.int64] | None
    ) -> list[bpy.types.FCurve]:
        curves = [_new_curve(self._channels, path, component, group) for component in range(values.shape[1])]
        for component, curve in enumerate(curves):
            if keys is None:
                _fill(curve, self._frames, values[:, component], self._straight)
            else:
                _fill_eased(curve, self._frames[keys], values[keys, component], steep[keys, component])
        return curves


def _check(frames: Array, rotations: Array, positions: Array, skeleton: Skeleton) -> None:
    count = len(frames)
    if count == 0:
        raise CharacterError("there are no frames to write", advice="record something first")
    if rotations.shape != (count, len(skeleton), 4) or positions.shape != (count, 3):
        raise CharacterError(
            f"{count} frames of {len(skeleton)} joints cannot have arrays {rotations.shape} and {positions.shape}"
        )
    if np.any(np.diff(frames) <= 0.0):
        first = int(np.argmax(np.diff(frames) <= 0.0))
        raise CharacterError("the frames' times do not increase", where=f"pose {first + 1}")
    if not (np.all(np.isfinite(rotations)) and np.all(np.isfinite(positions)) and np.all(np.isfinite(frames))):
        raise CharacterError("poses must be finite numbers")


def _assign(animation: bpy.types.AnimData, action: bpy.types.Action) -> None:
    """Make an action the one that is played; an earlier one keeps a fake user, so saving does not drop it."""
    if animation.action is not None:
        animation.action.use_fake_user = True
    animation.action = action
    if HAS_SLOTS:
        animation.action_slot = action.slots[0]


def played(armature_object: bpy.types.Object) -> tuple[Any, ...] | None:
    """Return what an armature plays, for `play`; None without animation."""
    animation = armature_object.animation_data
    return None if animation is None else (animation.action, _slot_of(animation), animation.use_nla)


def play(armature_object: bpy.types.Object, before: tuple[Any, ...] | None) -> None:
    """Let an armature play what `played` returned earlier."""
    if before is None:
        armature_object.animation_data_clear()
        return
    animation = armature_object.animation_data
    animation.action, slot, animation.use_nla = before
    if slot is not None:
        animation.action_slot = slot


def _new_channels(action: bpy.types.Action, armature_object: bpy.types.Object) -> Any:
    """Return what curves of a new action are added to: a slot's channel bag, or before 4.4 the action itself."""
    if not HAS_SLOTS:
        return action
    slot = action.slots.new(id_type="OBJECT", name=armature_object.name)
    return action.layers.new("Layer").strips.new(type="KEYFRAME").channelbag(slot, ensure=True)


def _push_down(animation: bpy.types.AnimData) -> None:
    """Make the action that is played a strip of its own, as Blender's Push Down does, below what follows."""
    action = animation.action
    if action is None:
        return
    first, last = (float(frame) for frame in action.frame_range)
    if any(_channels_of(action, _slot_of(animation))):
        strip = _add_strip(animation, action, (first, last), 0.0, _slot_of(animation))
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


def _slot_of(animated: bpy.types.AnimData | bpy.types.NlaStrip) -> Any:
    """Return the slot of the action that is played, None before 4.4."""
    return animated.action_slot if HAS_SLOTS else None


def _channels_of(action: bpy.types.Action, slot: Any) -> Iterator[Any]:
    """Yield what holds an action's curves: channel bags of a slot, or before 4.4 the action itself."""
    if not HAS_SLOTS:
        yield action
        return
    for layer in action.layers:
        for strip in layer.strips:
            bag = strip.channelbag(slot) if slot is not None and strip.type == "KEYFRAME" else None
            if bag is not None:
                yield bag


def keep_in_quaternions(armature_object: bpy.types.Object, bones: Collection[str]) -> None:
    """Give what is played quaternion curves beside others, for bones that are about to be turned by quaternions."""
    animation = armature_object.animation_data
    if animation is None:
        return
    tracks = animation.nla_tracks if animation.use_nla else ()
    strips = [strip for track in tracks for strip in track.strips if strip.type == "CLIP"]
    played = {(used.action, _slot_of(used)) for used in (animation, *strips) if used.action is not None}
    turned = [armature_object.pose.bones[name] for name in bones]
    turned = [bone for bone in turned if bone.rotation_mode != "QUATERNION"]
    for action, slot in played:
        for channels in _channels_of(action, slot) if action.is_editable and turned else ():
            known = {(curve.data_path, curve.array_index): curve for curve in channels.fcurves}
            for bone in turned:
                if (_bone_path(bone.name, "rotation_quaternion"), 0) not in known:
                    _add_quaternions(channels, known, bone)


def _add_quaternions(channels: Any, known: dict[tuple[str, int], Any], bone: bpy.types.PoseBone) -> None:
    """Add what a bone's curves in another mode amount to in each frame."""
    is_axis_angle = bone.rotation_mode == "AXIS_ANGLE"
    channel = "rotation_axis_angle" if is_axis_angle else "rotation_euler"
    path, now = _bone_path(bone.name, channel), list(getattr(bone, channel))
    curves = [known.get((path, component)) for component in range(len(now))]
    keyed = [key.co[0] for curve in curves if curve is not None for key in curve.keyframe_points]
    if not keyed:
        return
    frames = np.union1d(np.arange(np.floor(min(keyed)), np.ceil(max(keyed)) + 1.0), keyed)
    values = [
        [curve.evaluate(frame) if curve is not None else still for curve, still in zip(curves, now, strict=True)]
        for frame in frames
    ]
    turns = [Quaternion(v[1:], v[0]) if is_axis_angle else Euler(v, bone.rotation_mode).to_quaternion() for v in values]
    quaternions = rot.continuous(np.array(turns, dtype=np.float64))
    for component in range(4):
        curve = _new_curve(channels, _bone_path(bone.name, "rotation_quaternion"), component, bone.name)
        _fill(curve, frames, quaternions[:, component], straight=True)


def _quaternions_at(armature_object: bpy.types.Object, bones: list[str], frame: float) -> Array:
    """Return the rotations (B, 4) of bones as they are played at a frame of the scene."""
    scene = bpy.context.scene
    before = scene.frame_current_final
    scene.frame_set(int(np.floor(frame)), subframe=frame - np.floor(frame))
    evaluated = armature_object.evaluated_get(bpy.context.evaluated_depsgraph_get())
    found = np.array([evaluated.pose.bones[name].rotation_quaternion for name in bones], dtype=np.float64)
    scene.frame_set(int(np.floor(before)), subframe=before - np.floor(before))
    return found.reshape(-1, 4)


def _new_curve(channels: Any, path: str, component: int, group: str) -> bpy.types.FCurve:
    if not HAS_SLOTS:
        return channels.fcurves.new(path, index=component, action_group=group)
    curve = channels.fcurves.new(path, index=component)
    curve.group = channels.groups.get(group) or channels.groups.new(group)
    return curve


def _fill(curve: bpy.types.FCurve, frames: Array, values: Array, straight: bool) -> None:
    points = curve.keyframe_points
    points.add(len(frames))
    points.foreach_set("co", np.stack((frames, values), axis=1).astype(np.float32).ravel())
    if straight:
        points.foreach_set("interpolation", np.full(len(frames), _LINEAR, dtype=np.int32))
    curve.update()


def _fill_eased(curve: bpy.types.FCurve, frames: Array, values: Array, steep: Array) -> None:
    """Set keys with the curve's slope at each; handles reach a third of the way, which makes cubics of the curve."""
    _fill(curve, frames, values, straight=False)
    gaps = np.diff(frames) / 3.0
    before, after = np.append(gaps[:1], gaps), np.append(gaps, gaps[-1:])
    points = curve.keyframe_points
    for side, reach in (("left", -before), ("right", after)):
        points.foreach_set(f"handle_{side}_type", np.full(len(frames), _ALIGNED, dtype=np.int32))
        if len(gaps):
            handles = np.stack((frames + reach, values + reach * steep), axis=1)
            points.foreach_set(f"handle_{side}", handles.astype(np.float32).ravel())
    curve.update()


def _bone_path(bone_name: str, channel: str) -> str:
    return f'pose.bones["{bpy.utils.escape_identifier(bone_name)}"].{channel}'


def curves_of(armature_object: bpy.types.Object) -> list[bpy.types.FCurve]:
    """Return the animation curves of the object's assigned action (of its slot from 4.4), empty without one."""
    animation = armature_object.animation_data
    if animation is None or animation.action is None:
        return []
    return [curve for bag in _channels_of(animation.action, _slot_of(animation)) for curve in bag.fcurves]
