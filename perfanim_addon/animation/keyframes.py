"""Keyframes of sampled values: one per frame, or reduced within bounds."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import bpy
import numpy as np
from numpy.typing import ArrayLike

from ...core.body.keyframe_reduction import location_keys, rotation_keys, slopes
from ...core.geometry.arrays import Array, IntArray, Mask
from ..blender_versions import new_channels, new_curve

# types of the keys of hand poses, which no take has: where the pose is reached, and where it is left
REACHED, LEFT = "EXTREME", "BREAKDOWN"
_JITTER = 3  # Keyframe.type "JITTER" as foreach_set expects it
_LINEAR = 1  # Keyframe.interpolation "LINEAR" as foreach_set expects it
_ALIGNED = 3  # Keyframe.handle_left_type "ALIGNED"


@dataclass(frozen=True)
class KeyBounds:
    """Largest errors of reduced curves in any recorded frame."""

    rotation_deg: float  # largest rotation error of each bone relative to its parent
    location_mm: float  # largest location error of each moved bone, in the scene


class KeyWriter:
    """Adds curves to a new action.

    Args:
        animated: Object that will play the action.
        action: Action without curves.
        frames: Scene frame (F,) of each value.
        bounds: Bounds of the key reduction; None for a key in every frame.
        marked: Scene frames whose keys get the type Jitter.
        doubtful: Further scene frames with such keys, per group.
        leave_out: Insert no keys in the doubtful frames, except the first and the last.
    """

    def __init__(
        self,
        animated: bpy.types.Object,
        action: bpy.types.Action,
        frames: Array,
        bounds: KeyBounds | None,
        marked: Collection[float] = (),
        doubtful: Mapping[str, Collection[float]] | None = None,
        leave_out: bool = False,
    ) -> None:
        self._channels = new_channels(action, animated)
        self._frames = frames
        self._bounds = bounds
        self._marked = np.isin(frames, list(marked))
        self._doubtful, self._leave_out = doubtful or {}, leave_out
        # keys at most two frames apart need no smooth interpolation
        self._straight = len(frames) < 2 or float(np.mean(np.diff(frames))) <= 2.0
        scale = float(np.mean(np.abs(animated.matrix_world.to_scale())))
        self._unit_mm = 1000.0 * bpy.context.scene.unit_settings.scale_length * max(scale, 1e-9)

    def rotate(self, path: str, group: str, quaternions: Array, signs: ArrayLike = (1.0, 1.0)) -> None:
        """Add the four curves of a rotation (F, 4), multiplied by one sign at the start and one at the end.

        If the signs differ, the sign changes halfway, between two keys with constant interpolation.
        """
        first, last = np.asarray(signs, dtype=np.float64)
        kept, types = self._kept(group)
        frames, quaternions = self._frames[kept], quaternions[kept]
        bounds, half = self._bounds, len(quaternions) // 2 if first != last else 0
        pieces = [slice(0, half), slice(half, None)] if half else [slice(None)]
        signed = np.concatenate((first * quaternions[:half], last * quaternions[half:]))
        steep = np.concatenate([slopes(frames[piece], signed[piece]) for piece in pieces])
        keys = None
        if bounds:
            bound = np.radians(bounds.rotation_deg)
            found = [rotation_keys(frames[piece], signed[piece], bound) for piece in pieces]
            keys = np.concatenate((found[0], *(half + more for more in found[1:])))
        for curve in self._add(path, group, (frames, signed, steep, types), keys):
            if half:
                held = half if keys is None else int(np.searchsorted(keys, half))
                curve.keyframe_points[held - 1].interpolation = "CONSTANT"

    def move(self, path: str, group: str, locations: Array) -> None:
        """Add the three curves of a location (F, 3) in the object's unit."""
        bounds, (kept, types) = self._bounds, self._kept(group)
        frames, locations = self._frames[kept], locations[kept]
        keys = location_keys(frames, locations, bounds.location_mm / self._unit_mm) if bounds else None
        self._add(path, group, (frames, locations, slopes(frames, locations), types), keys)

    def _kept(self, group: str) -> tuple[Mask, IntArray]:
        """Return the frames (F,) in which a group has keys, and the types of these keys."""
        doubtful = np.isin(self._frames, list(self._doubtful.get(group, ())))
        kept = ~(doubtful & self._leave_out)
        kept[[0, -1]] = True
        return kept, np.where((doubtful | self._marked)[kept], _JITTER, 0).astype(np.int32)

    def _add(
        self, path: str, group: str, samples: tuple[Array, Array, Array, IntArray], keys: IntArray | None
    ) -> list[bpy.types.FCurve]:
        """Add curves with keys at all or some samples (frames, values, slopes, key types)."""
        frames, values, steep, types = samples
        curves = [new_curve(self._channels, path, component, group) for component in range(values.shape[1])]
        for component, curve in enumerate(curves):
            if keys is None:
                fill(curve, frames, values[:, component], self._straight, types)
            else:
                _fill_eased(curve, frames[keys], values[keys, component], steep[keys, component], types[keys])
        return curves


def fill(curve: bpy.types.FCurve, frames: Array, values: Array, straight: bool, types: IntArray | None = None) -> None:
    """Set a key in each frame, with linear interpolation if `straight`."""
    points = curve.keyframe_points
    points.add(len(frames))
    points.foreach_set("co", np.stack((frames, values), axis=1).astype(np.float32).ravel())
    if straight:
        points.foreach_set("interpolation", np.full(len(frames), _LINEAR, dtype=np.int32))
    if types is not None and types.any():
        points.foreach_set("type", types)
    curve.update()  # merges keys that are almost at the same time


def _fill_eased(curve: bpy.types.FCurve, frames: Array, values: Array, steep: Array, types: IntArray) -> None:
    """Set keys with slopes; handles at a third of the distance make the curves cubic."""
    fill(curve, frames, values, False, types)
    gaps = np.diff(frames) / 3.0
    before, after = np.append(gaps[:1], gaps), np.append(gaps, gaps[-1:])
    points = curve.keyframe_points
    for side, reach in (("left", -before), ("right", after)):
        points.foreach_set(f"handle_{side}_type", np.full(len(frames), _ALIGNED, dtype=np.int32))
        if len(gaps):
            handles = np.stack((frames + reach, values + reach * steep), axis=1)
            points.foreach_set(f"handle_{side}", handles.astype(np.float32).ravel())
    curve.update()


def is_hand_pose(curve: bpy.types.FCurve) -> bool:
    """Return whether a curve has the keys of hand poses."""
    return len(curve.keyframe_points) > 0 and all(key.type in (REACHED, LEFT) for key in curve.keyframe_points)


def bone_path(bone_name: str, channel: str) -> str:
    """Return the data path of a property of a bone."""
    return f'pose.bones["{bpy.utils.escape_identifier(bone_name)}"].{channel}'
