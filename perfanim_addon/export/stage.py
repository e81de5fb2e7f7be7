"""Stage for a scene: floor, light, camera, picture, and saving the file."""

from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np
from mathutils import Vector

from ...core.body.body_size import SOLE_BELOW_TOES_M, girth_scale
from ...core.body.motion import Motion
from ...core.body.skeleton import forward_kinematics
from ...core.geometry.arrays import Array
from ...core.system.files import atomic_path
from ..blender_versions import enable_nodes
from ..character import axes
from ..character.body_mesh import new_material


@dataclass(frozen=True)
class Stage:
    """Settings for pictures of a performance."""

    lens_mm: float = 50.0
    pixels: tuple[int, int] = (480, 640)
    samples: int = 16  # Cycles samples per pixel
    floor_percentile: float = 2.0  # percentile of the toes' heights: outliers and short dips do not lower the floor
    towards: tuple[float, float, float] = (0.45, -1.0, 0.18)  # direction to the camera: front left of the performer
    beside_m: float = 0.15  # margin around the joints in the picture
    above_m: float = 0.25
    sky: tuple[float, float, float] = (0.55, 0.60, 0.66)


_STAGE = Stage()


def write_scene(path: Path) -> None:
    """Write the open scene to a file."""
    bpy.context.preferences.filepaths.save_version = 0  # no backup file
    bpy.ops.wm.save_as_mainfile(filepath=str(path), compress=True, check_existing=False)


def floor_below(motion: Motion) -> float:
    """Return the height of the floor below a motion's soles."""
    positions, _ = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)
    toes = positions[:, [motion.skeleton.index(side + "toes") for side in "lr"]]
    lowest = axes.points_to_blender(toes)[..., 2].min(axis=1)
    return float(np.percentile(lowest, _STAGE.floor_percentile)) - SOLE_BELOW_TOES_M * girth_scale(motion.skeleton)


def add_stage(scene: bpy.types.Scene, points: Array, floor: float) -> None:
    """Add floor, light and a camera that shows all points (N, 3)."""
    low, high = points.min(axis=0), points.max(axis=0)
    low[2] = floor
    _add_floor(low, high, floor)
    _add_lights(scene, 0.5 * (low + high), floor)
    _add_camera(scene, points, 0.5 * (low + high))


def _add_floor(low: Array, high: Array, height: float) -> None:
    centre, half = 0.5 * (low + high), 0.5 * float(np.max((high - low)[:2])) + 6.0
    corners = [(centre[0] + half * x, centre[1] + half * y, height) for x, y in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    mesh = bpy.data.meshes.new("Floor")
    mesh.from_pydata(corners, [], [(0, 1, 2, 3)])
    mesh.materials.append(new_material("Floor", (0.32, 0.33, 0.35), 0.8))
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("Floor", mesh))


def _add_lights(scene: bpy.types.Scene, centre: Array, floor: float) -> None:
    sun = bpy.data.lights.new("Sun", "SUN")
    sun.energy = 4.0
    sun.angle = np.radians(12.0)  # soft shadows
    sun_object = bpy.data.objects.new("Sun", sun)
    sun_object.location = (centre[0] - 3.0, centre[1] - 4.0, floor + 5.0)
    _look_at(sun_object, centre)
    scene.collection.objects.link(sun_object)
    scene.world = bpy.data.worlds.new("World")
    scene.world.color = _STAGE.sky
    enable_nodes(scene.world)
    for node in scene.world.node_tree.nodes:
        if node.type == "BACKGROUND":
            node.inputs["Color"].default_value = (*_STAGE.sky, 1.0)
            node.inputs["Strength"].default_value = 1.0


def _add_camera(scene: bpy.types.Scene, joints: Array, centre: Array) -> None:
    """Add a camera that shows the whole motion."""
    camera = bpy.data.cameras.new("Camera")
    camera.lens = _STAGE.lens_mm
    camera_object = bpy.data.objects.new("Camera", camera)
    towards = np.array(_STAGE.towards) / np.linalg.norm(_STAGE.towards)
    distance = _fitting_distance(camera, joints - centre, towards)
    camera_object.location = centre + distance * towards
    camera.clip_end = 10.0 * distance
    _look_at(camera_object, centre)
    scene.collection.objects.link(camera_object)
    scene.camera = camera_object


def _fitting_distance(camera: bpy.types.Camera, points: Array, towards: Array) -> float:
    """Return the distance of an upright camera that shows all points (N, 3)."""
    across = np.cross([0.0, 0.0, 1.0], towards)
    across /= np.linalg.norm(across)
    wide = camera.lens / (0.5 * camera.sensor_width)
    narrow = wide * max(_STAGE.pixels) / min(_STAGE.pixels)
    near = points @ towards
    aside, above = np.abs(points @ across), np.abs(points @ np.cross(towards, across))
    return float(np.max(near + np.maximum(narrow * (aside + _STAGE.beside_m), wide * (above + _STAGE.above_m))))


def _look_at(obj: bpy.types.Object, point: Array) -> None:
    direction = Vector(point.tolist()) - obj.location
    obj.rotation_euler = direction.to_track_quat("-Z", "Y").to_euler()


def set_up_rendering(scene: bpy.types.Scene) -> None:
    """Make Cycles render small pictures on the CPU."""
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.samples = _STAGE.samples
    scene.cycles.use_denoising = False
    scene.cycles.max_bounces = 4
    scene.render.resolution_x, scene.render.resolution_y = _STAGE.pixels
    scene.render.resolution_percentage = 100
    scene.view_settings.view_transform = "Standard"


def render(scene: bpy.types.Scene, target: Path) -> None:
    """Render the current frame to a .png file."""
    scene.render.image_settings.file_format = "PNG"
    with atomic_path(target.with_suffix(".png")) as temporary:
        bpy.ops.render.render()  # given a file name, Blender would expand braces in it as variables
        bpy.data.images["Render Result"].save_render(str(temporary), scene=scene)
