"""Draw the moving picture of the README: camera, skeleton and character.

    python tools/moving_picture.py --out docs/pictures/live.webp

Performer and cameras are simulated; their pictures are tracked and solved as those of real cameras are. Needs bpy.
"""

import argparse
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import bpy
import cv2
import numpy as np
from mathutils import Matrix
from perfanim.core.body.motion import Motion
from perfanim.core.body.scene_pose import PerformerPose, ScenePose
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.database.build_database import build_database
from perfanim.core.database.store import open_database
from perfanim.core.geometry.arrays import Array, Image
from perfanim.core.geometry.camera import Camera
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.session.pose_filters import FilterSettings, filter_poses
from perfanim.core.session.session import Session
from perfanim.core.session.solve_take import motion_of
from perfanim.core.simulate.preview import (
    brightened,
    draw_caption,
    draw_detections,
    floor_image,
    preview_camera,
    side_by_side,
)
from perfanim.core.simulate.studio.simulated_source import SimulatedSource, open_simulated
from perfanim.core.solver.settings import SolveSettings
from perfanim.core.system.assets import MOTION
from perfanim.core.vision.pipeline import MarkerPipeline
from perfanim.perfanim_addon.animation.actions import scene_frames, write_with_plan
from perfanim.perfanim_addon.character import axes
from perfanim.perfanim_addon.character.create_character import create_character, find_armature
from perfanim.perfanim_addon.character.posing import plan_for
from perfanim.perfanim_addon.export.stage import add_stage, render, set_up_rendering
from PIL import Image as Pictures

EMPTY_FRAMES = 60
EVERY = 4  # of the cameras' 60 images a second
PANEL_PX = (300, 300)
DRAWN_AT = 2  # times as large, then reduced
SAMPLES = 24
QUALITY = 70  # of WebP
MOST_BYTES = 1_500_000
BONE, MARKER = (200.0, 190.0, 180.0), (60.0, 200.0, 255.0)  # blue, green, red


@dataclass(frozen=True)
class Performed:
    """Tracked frames and filtered poses of a performance.

    Args:
        shown: numbers of the frames to show.
    """

    source: SimulatedSource
    frames: Sequence[MarkerFrame]
    poses: Sequence[PerformerPose]
    shown: Sequence[int]


def perform(behaviour: str, start_s: float, seconds: float) -> Performed:
    """Simulate, track and solve a performance."""
    source = open_simulated({"behaviour": behaviour})
    pipeline = MarkerPipeline(source.rig)
    pipeline.learn_empty(list(source.background_frames(EMPTY_FRAMES)))
    first, last = round(start_s * source.fps), round((start_s + seconds) * source.fps)
    frames = [pipeline.process(source.frame(number)) for number in range(last + 1)]
    with tempfile.TemporaryDirectory() as folder:
        build_database([MOTION], Path(folder) / "starter.pfdb")
        session = Session(source.subject, open_database(Path(folder) / "starter.pfdb"), source.rig, SolveSettings())
        solved = [session.step(frame) for frame in frames]
    scenes = [ScenePose((pose,)) for pose in solved]
    filtered = filter_poses(scenes, [source.subject.skeleton], 0.0, FilterSettings(feet="auto"))
    return Performed(source, frames, [scene.performers[0] for scene in filtered], range(first, last, EVERY))


def view_of(performed: Performed) -> Camera:
    """Return a virtual camera that shows the whole performance."""
    paths = np.array([performed.poses[number].root_position_m for number in performed.shown])
    return preview_camera(paths, (DRAWN_AT * PANEL_PX[0], DRAWN_AT * PANEL_PX[1]))


def draw_filmed(performed: Performed, number: int) -> Image:
    """Return the middle of the left camera's image, its detections ringed."""
    picture = brightened(performed.source.frame(number).images[0])
    draw_detections(picture, performed.frames[number].detected[0][:, :2])
    height, width = picture.shape[:2]
    left = (width - height) // 2
    return picture[:, left : left + height]


def draw_skeleton(performed: Performed, view: Camera, stage: Image, number: int) -> Image:
    """Return the solved skeleton as lines, and the markers where they were located."""
    picture, pose, skeleton = stage.copy(), performed.poses[number], performed.source.subject.skeleton
    joints, _ = forward_kinematics(skeleton, pose.rotations, pose.root_position_m)
    pixels = view.project(joints)
    for joint, parent in enumerate(skeleton.parents):
        if parent >= 0:
            _line(picture, pixels[parent], pixels[joint])
    for pixel in view.project(performed.frames[number].points_m):
        cv2.circle(picture, _fixed(pixel), 9 * 16, MARKER, cv2.FILLED, cv2.LINE_AA, 4)
    return picture


def _line(picture: Image, start: Array, end: Array) -> None:
    cv2.line(picture, _fixed(start), _fixed(end), BONE, 5, cv2.LINE_AA, 4)


def _fixed(pixel: Array) -> tuple[int, int]:
    """Return a place in sixteenths of a pixel, as OpenCV takes it."""
    return round(16.0 * float(pixel[0])), round(16.0 * float(pixel[1]))


def render_character(performed: Performed, view: Camera, folder: Path) -> list[Image]:
    """Return Blender's pictures of a new character with the motion, seen by a camera."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    set_up_rendering(scene)
    scene.cycles.samples = SAMPLES
    scene.render.resolution_x, scene.render.resolution_y = PANEL_PX
    motion = _shown_motion(performed)
    scene.render.fps = round(motion.fps)
    character = find_armature(create_character(bpy.context, motion.skeleton))
    plan = plan_for(character, motion.skeleton)
    frames = scene_frames(np.arange(motion.frames) / motion.fps, scene)
    write_with_plan(character, frames, motion.rotations, motion.root_positions_m, plan, name="Capture")
    add_stage(scene, axes.points_to_blender(motion.root_positions_m), 0.0)
    _place(scene.camera, view)
    pictures = []
    for frame in frames.tolist():
        scene.frame_set(int(frame))
        render(scene, folder / "frame.png")
        picture = cv2.imread(str(folder / "frame.png"))
        assert picture is not None  # noqa: S101 - just written
        pictures.append(np.asarray(picture, dtype=np.uint8))
    return pictures


def _shown_motion(performed: Performed) -> Motion:
    poses = [performed.poses[number] for number in performed.shown]
    return motion_of(poses, performed.source.subject, "Capture", performed.source.fps / EVERY)


def _place(camera_object: bpy.types.Object, view: Camera) -> None:
    """Give Blender's camera the place, direction and angle of a pinhole camera."""
    turned = axes.BLENDER_FROM_WORLD @ view.rotation.T @ np.diag([1.0, -1.0, -1.0])  # OpenCV looks along z, y down
    place = np.eye(4)
    place[:3, :3], place[:3, 3] = turned, axes.points_to_blender(view.centre_m)
    camera_object.matrix_world = Matrix(place.tolist())
    camera_object.data.lens = camera_object.data.sensor_width * view.focal_px / max(view.image_size)


def assemble(performed: Performed) -> list[Image]:
    """Return the pictures of all shown frames, three panels each."""
    view = view_of(performed)
    stage = floor_image(view)
    with tempfile.TemporaryDirectory() as folder:
        rendered = render_character(performed, view, Path(folder))
    pictures = []
    for number, character in zip(performed.shown, rendered, strict=True):
        panels = [draw_filmed(performed, number), draw_skeleton(performed, view, stage, number), character]
        panels = [np.asarray(cv2.resize(panel, PANEL_PX, interpolation=cv2.INTER_AREA)) for panel in panels]
        for panel, title in zip(panels, ("camera", "markers and skeleton", "character in Blender"), strict=True):
            draw_caption(panel, title)
        pictures.append(side_by_side(*panels))
    return pictures


def write_moving(path: Path, pictures: Sequence[Image], fps: float) -> None:
    """Write pictures as an animation that starts again at its end."""
    first, *others = [Pictures.fromarray(np.ascontiguousarray(picture[..., ::-1])) for picture in pictures]
    path.parent.mkdir(parents=True, exist_ok=True)
    duration_ms = round(1000.0 / fps)
    first.save(
        path,
        save_all=True,
        append_images=others,
        duration=duration_ms,
        loop=0,
        quality=QUALITY,
        method=6,
        minimize_size=True,
    )


def main() -> int:
    """Write the picture; return 1 if it is too large for a page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, required=True, help=".webp to write")
    parser.add_argument("--behaviour", default="demo", help="of the simulated performer (default demo)")
    parser.add_argument("--start", type=float, default=7.6, help="second of the performance (default 7.6)")
    parser.add_argument("--seconds", type=float, default=8.0, help="length (default 8)")
    options = parser.parse_args()
    performed = perform(options.behaviour, options.start, options.seconds)
    write_moving(options.out, assemble(performed), performed.source.fps / EVERY)
    size = options.out.stat().st_size
    sys.stdout.write(f"{options.out}: {size / 1e6:.2f} MB\n")
    return 1 if size > MOST_BYTES else 0


if __name__ == "__main__":
    sys.exit(main())
