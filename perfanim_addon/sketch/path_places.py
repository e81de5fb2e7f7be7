"""Positions of a control along its path, computed without changing the scene's frame."""

from collections.abc import Iterable, Mapping

import bpy
import numpy as np

from ...core.geometry.arrays import Array
from ..blender_versions import by_channel
from .controls import only_constraint


def places_on_path(
    context: bpy.types.Context, control: bpy.types.Object, curves: Iterable[bpy.types.FCurve], frames: Iterable[int]
) -> Mapping[int, Array] | None:
    """Return frame -> location in the scene of a control on a path, from its action's curves, accurate to millimetres.

    The result is None for a control with a parent, or with constraints other than one *Follow Path* at full influence
    with *Fixed Position*: only the evaluated scene shows those.
    """
    held = only_constraint(control, "FOLLOW_PATH")
    if held is None or not held.use_fixed_location or held.use_curve_follow:
        return None
    points, channels = _points_of(context, held.target), by_channel(curves)
    if len(points) < 2:
        return None
    lengths = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))))
    world = np.array(held.target.matrix_world)
    share_path, found = f'constraints["{held.name}"].offset_factor', {}
    for frame in frames:
        share = channels.get((share_path, 0))
        at = lengths[-1] * float(np.clip(share.evaluate(frame) if share else held.offset_factor, 0.0, 1.0))
        place = [np.interp(at, lengths, axis) for axis in points.T]
        for axis in range(3):
            own = channels.get(("location", axis))
            place[axis] += own.evaluate(frame) if own is not None else control.location[axis]
        found[frame] = world[:3, :3] @ np.array(place) + world[:3, 3]
    return found


def _points_of(context: bpy.types.Context, path: bpy.types.Object) -> Array:
    """Return the points (P, 3) of a curve's first spline in its own space."""
    shown = path.evaluated_get(context.evaluated_depsgraph_get())
    mesh = shown.to_mesh()
    if mesh is None or not len(mesh.edges):
        return np.zeros((0, 3))
    points, edges = np.empty(3 * len(mesh.vertices)), np.empty(2 * len(mesh.edges), dtype=np.int32)
    mesh.vertices.foreach_get("co", points)
    mesh.edges.foreach_get("vertices", edges)
    shown.to_mesh_clear()
    # edges of the first spline lead from each vertex to the next, and back to the first if it is closed
    ends = edges.reshape(-1, 2)
    ahead = np.flatnonzero((ends[:, 1] - ends[:, 0] != 1) | (ends[:, 0] != np.arange(len(ends))))
    count = int(ahead[0]) if len(ahead) else len(ends)
    order = [*range(count + 1), *([0] if len(ahead) and set(ends[count]) == {0, count} else [])]
    return points.reshape(-1, 3)[order]
