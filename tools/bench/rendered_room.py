"""The shipped character in a lit room, rendered by Blender as a module (Cycles, so no screen is needed)."""

from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix
from perfanim.core.body.body_size import standing_root_m
from perfanim.core.body.motion import Motion
from perfanim.core.geometry.camera import Camera, CameraRig
from perfanim.perfanim_addon.character import axes, body_mesh

from .rendered_person import ROOM, skin

_SENSOR_MM = 36.0
_WALL, _FLOOR = (0.62, 0.60, 0.55), (0.32, 0.22, 0.14)  # linear RGB


def render(motion: Motion, rig: CameraRig, folder: Path) -> None:
    """Write a picture of each frame by each camera: folder/CAMERA/NUMBER.png."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    _add_room()
    heads_m = motion.skeleton.rest_positions_m + standing_root_m(motion.skeleton)
    body = body_mesh.fitted_body(motion.skeleton, heads_m)
    mesh = _add_body(body)
    scene.render.engine, scene.cycles.device = "CYCLES", "CPU"
    scene.cycles.samples, scene.cycles.use_denoising = ROOM.samples, False
    scene.cycles.max_bounces, scene.render.use_persistent_data = ROOM.bounces, True
    scene.render.resolution_x, scene.render.resolution_y = ROOM.size
    scene.view_settings.view_transform = "Standard"
    scene.render.image_settings.file_format = "PNG"
    cameras = [_add_camera(camera) for camera in rig.cameras]
    for number, vertices_m in enumerate(skin(motion, body.vertices_m, body.weights)):
        mesh.vertices.foreach_set("co", axes.points_to_blender(vertices_m).astype(np.float32).ravel())
        mesh.update()
        for camera, obj in zip(rig.cameras, cameras, strict=True):
            scene.camera = obj
            scene.render.filepath = str(folder / camera.name / f"{number:04d}.png")
            bpy.ops.render.render(write_still=True)


def _add_body(body: body_mesh.Body) -> bpy.types.Mesh:
    mesh = bpy.data.meshes.new("body")
    mesh.from_pydata(axes.points_to_blender(body.vertices_m).tolist(), [], body.faces.tolist())
    for name in body.material_names:
        mesh.materials.append(body_mesh.character_material(name))
    mesh.polygons.foreach_set("material_index", body.materials.astype(np.int32))
    mesh.polygons.foreach_set("use_smooth", np.ones(len(body.faces), dtype=bool))
    _link("body", mesh)
    return mesh


def _add_room() -> None:
    """Add a floor, four walls, two lamps and some light from everywhere."""
    far = ROOM.room_m
    _add_plane("floor", [(-far, -far, 0), (far, -far, 0), (far, far, 0), (-far, far, 0)], _FLOOR)
    corners = [(-far, -far), (far, -far), (far, far), (-far, far)]
    for number, ((x, y), (u, v)) in enumerate(zip(corners, [*corners[1:], corners[0]], strict=True)):
        _add_plane(f"wall {number}", [(x, y, 0), (u, v, 0), (u, v, 3), (x, y, 3)], _WALL)
    for x, y in ((-1.5, -2.0), (2.0, 1.5)):
        lamp = bpy.data.lights.new("lamp", "AREA")
        lamp.energy, lamp.size = 0.5 * ROOM.lamp_w, 1.5
        _link("lamp", lamp).location = (x, y, 2.9)
    world = bpy.context.scene.world = bpy.data.worlds.new("world")
    world.color = (0.4, 0.4, 0.4)


def _add_plane(name: str, corners: list[tuple[float, float, float]], colour: tuple[float, float, float]) -> None:
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(corners, [], [(0, 1, 2, 3)])
    mesh.materials.append(body_mesh.new_material(name, colour, 0.8))
    _link(name, mesh)


def _add_camera(camera: Camera) -> bpy.types.Object:
    width = camera.image_size[0]
    lens = bpy.data.cameras.new(camera.name)
    lens.sensor_width, lens.lens = _SENSOR_MM, _SENSOR_MM * camera.focal_px / width
    obj = _link(camera.name, lens)
    # Blender's cameras look along -z, with y up
    turn = (camera.rotation.T @ np.diag((1.0, -1.0, -1.0))).T
    rows = np.eye(4)
    rows[:3, :3] = axes.points_to_blender(turn).T
    rows[:3, 3] = axes.points_to_blender(camera.centre_m[None])[0]
    obj.matrix_world = Matrix(rows.tolist())
    return obj


def _link(name: str, data: bpy.types.ID) -> bpy.types.Object:
    obj = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(obj)
    return obj
