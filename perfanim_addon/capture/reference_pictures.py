"""A take's films or pictures behind Blender cameras that stand where the real ones stood, and sound, in time."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Quaternion, Vector

from ...core.errors import CaptureError, TakeError
from ...core.formats.take_file.take_reader import TakeFile
from ...core.geometry import rotations as rot
from ...core.geometry.arrays import Array
from ...core.geometry.camera import Camera
from ...core.system.files import is_file
from ...core.vision.sources.file_endings import VIDEO_ENDINGS
from ..animation.actions import scene_fps
from ..blender_versions import sequencer_strips
from ..character.axes import BLENDER_FROM_WORLD

_SENSOR_MM = 36.0
_SOUND = "Perfanim sound"
_MOST_FRAMES = 1_000_000  # longest sequence in Blender
_LAST_NUMBER = re.compile(r"(\d+)(?=\D*$)")
_BLENDER_CAMERA: Array = np.diag([1.0, -1.0, -1.0])  # OpenCV's camera axes from those of Blender's cameras


@dataclass(frozen=True)
class _Film:
    """Pictures of one camera: a film, or the first of numbered pictures.

    Args:
        fps: Pictures per second; 0 for numbered pictures, which have the take's rate.
        first: Number of the picture at the time 0 of the take's clock.
    """

    path: Path
    count: int
    fps: float
    first: int


def show_pictures(
    context: bpy.types.Context,
    take: TakeFile,
    poses_s: Sequence[float],
    start_frame: float,
    to_scene: Callable[[Array, Array], tuple[Array, Array]],
) -> list[str]:
    """Add a camera with its pictures in the background for each camera of a take; return the names of their objects.

    The sound of a film goes to the sequencer. Cameras and sound that were added for another take are replaced.

    Args:
        poses_s: Times of the shown poses on the take's clock.
        start_frame: Scene frame of the first of them.
        to_scene: Transform of rotations (..., 4) and positions (..., 3) of props from the capture space to the scene.

    Raises:
        TakeError: The take was not made from films or pictures of calibrated cameras, or these are not there any more.
    """
    rig, paths = take.setup.camera_rig(), _paths(take)
    if rig is None or len(paths) != len(rig):
        advice = "choose a take of films or pictures, or switch Reference Pictures off"
        raise TakeError("has no reference pictures", where=take.notes.name, advice=advice)
    starts_s = dict(take.setup.capture.get("source") or {}).get("starts_s") or [0.0] * len(paths)
    films = [_film(path) for path in paths]
    own_fps = 1.0 / float(np.median(np.diff(poses_s))) if len(poses_s) > 1 else 1.0
    made = []
    for camera, film, begins_s in zip(rig.cameras, films, starts_s, strict=True):
        obj = _camera_object(context, camera, to_scene)
        _show_behind(context, obj.data, film, film.fps or own_fps, (poses_s[0] - begins_s, start_frame))
        made.append(str(obj.name))
    since_s = [poses_s[0] - begins_s for begins_s in starts_s]
    _play_sound(context.scene, films, [start_frame - each * scene_fps(context.scene) for each in since_s])
    return made


def _play_sound(scene: bpy.types.Scene, films: Sequence[_Film], starts: Sequence[float]) -> None:
    """Add the first sound of films to the sequencer, in place of that of another take.

    Args:
        starts: Scene frame at which each film begins.
    """
    if scene.sequence_editor is not None and (old := sequencer_strips(scene).get(_SOUND)) is not None:
        sequencer_strips(scene).remove(old)
    for film, start in zip(films, starts, strict=True):
        sound = bpy.data.sounds.load(str(film.path))
        has_sound = sound.channels != "INVALID"  # pictures have none, either
        bpy.data.sounds.remove(sound)
        if has_sound:
            strips = sequencer_strips(scene)
            channel = 1 + max((strip.channel for strip in strips), default=0)
            strips.new_sound(_SOUND, str(film.path), channel, round(start))
            return


def _paths(take: TakeFile) -> list[str]:
    """Return the films or pictures of each camera of a take; none for other sources."""
    capture = take.setup.capture
    source = capture.get("source")
    named = source.get("paths") if isinstance(source, dict) else capture.get("tracked")
    return list(map(str, named)) if isinstance(named, list) else []


def _film(path: str) -> _Film:
    if path.lower().endswith(VIDEO_ENDINGS):
        if not is_file(path):
            raise TakeError("its film is not there any more", where=path, advice="put it back, or go without")
        clip = bpy.data.movieclips.load(path)
        try:
            return _Film(Path(path), int(clip.frame_duration), float(clip.fps), 1)
        finally:
            bpy.data.movieclips.remove(clip)
    from ...core.vision.sources.image_files import list_images  # OpenCV is slow to load

    try:
        files = list_images(path)
    except CaptureError as error:
        raise TakeError("its pictures are not there any more", where=path, advice="put them back") from error
    found = [_LAST_NUMBER.search(file.stem) for file in files]
    numbers = [int(each[0]) if each else -1 for each in found]
    if numbers != list(range(numbers[0], numbers[0] + len(numbers))):
        what = "its pictures are not numbered one after another"
        raise TakeError(what, where=path, advice="Blender shows pictures whose names end in consecutive numbers")
    return _Film(files[0], len(files), 0.0, numbers[0])


def _camera_object(
    context: bpy.types.Context, camera: Camera, to_scene: Callable[[Array, Array], tuple[Array, Array]]
) -> bpy.types.Object:
    """Return a new camera object that stands where a camera stood."""
    name = f"Perfanim {camera.name}"
    if (old := bpy.data.objects.get(name)) is not None and old.type == "CAMERA":
        bpy.data.cameras.remove(old.data)  # and the object
    data = bpy.data.cameras.new(name)
    obj = bpy.data.objects.new(name, data)
    (context.collection or context.scene.collection).objects.link(obj)
    axes = rot.from_matrix(camera.rotation.T @ _BLENDER_CAMERA)
    turn, place = to_scene(rot.multiply(axes, rot.from_matrix(BLENDER_FROM_WORLD)), camera.centre_m)
    obj.rotation_mode = "QUATERNION"
    obj.rotation_quaternion, obj.location = Quaternion(turn), Vector(place)
    width, height = camera.image_size
    render = context.scene.render
    is_wide = width * render.resolution_y >= height * render.resolution_x
    side, focal_px = (width, camera.matrix[0, 0]) if is_wide else (height, camera.matrix[1, 1])
    data.sensor_fit = "HORIZONTAL" if is_wide else "VERTICAL"  # the view's border is around the whole picture
    data.sensor_width = data.sensor_height = _SENSOR_MM
    data.lens = _SENSOR_MM * focal_px / side
    data.shift_x = (0.5 * (width - 1) - camera.matrix[0, 2]) / side
    data.shift_y = (camera.matrix[1, 2] - 0.5 * (height - 1)) / side
    return obj


def _show_behind(context: bpy.types.Context, data: Any, film: _Film, fps: float, start: tuple[float, float]) -> None:
    """Show the pictures behind a camera, in time.

    Args:
        fps: Pictures per second.
        start: A time since the first picture, and its scene frame.
    """
    image = bpy.data.images.load(str(film.path), check_existing=True)
    if not film.fps:
        image.source = "SEQUENCE"
    shown = data.background_images.new()
    shown.image, shown.alpha, shown.frame_method = image, 1.0, "FIT"
    user = shown.image_user
    user.frame_duration, user.frame_start, user.use_auto_refresh = _MOST_FRAMES, 1, True
    share, last = fps / scene_fps(context.scene), film.first + film.count - 1
    number = f"floor({film.first + start[0] * fps + 0.5:.4f} + {share:.6f} * (frame - {start[1]:.4f}))"
    # a film has another rate than the scene, and Blender shows one of its pictures for each frame of the scene
    driver = data.driver_add("background_images[0].image_user.frame_offset").driver
    driver.expression = f"min(max({number}, {film.first}), {last}) - frame"
    data.show_background_images = True
