"""The body of a new character."""

import bpy
import numpy as np
from numpy.typing import NDArray

from ..core.skeleton import Skeleton


def add_body(
    context: bpy.types.Context,
    skeleton: Skeleton,
    heads_m: NDArray[np.float64],
    armature_object: bpy.types.Object,
) -> bpy.types.Object:
    """Add the mesh."""
    mesh = bpy.data.meshes.new(armature_object.name + " body")
    body = bpy.data.objects.new(mesh.name, mesh)
    (context.collection or context.scene.collection).objects.link(body)
    return body
