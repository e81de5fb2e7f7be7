"""Films of a take behind Blender cameras: where the real ones stood, and in time with the motion."""

import wave
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from bpy_extras.object_utils import world_to_camera_view
from mathutils import Vector
from perfanim.core.body.scene_pose import ScenePose
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.formats.take_file.take_reader import read_take_file
from perfanim.core.formats.take_file.take_setup import TakeSetup
from perfanim.core.formats.take_file.whole_take import write_whole_take
from perfanim.core.geometry import rotations as rot
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.subject import Subject
from perfanim.core.simulate.studio.studio_rig import default_rig
from perfanim.core.simulate.studio.video import write_video
from solved_poses import performer_pose, write_poses

pytestmark = pytest.mark.usefixtures("as_recorded")

SKELETON, RIG = default_skeleton(1.75), default_rig()
ANNA = Subject("Anna", SKELETON, load_marker_set("boxing"))
FILM_FPS, POSES, BEFORE = 60.0, 90, 30  # pictures before the first pose of the take


@pytest.fixture
def films(tmp_path: Path) -> list[str]:
    """Films of both cameras, without anything on them but their length."""
    width, height = RIG.cameras[0].image_size
    paths = [str(tmp_path / f"{camera.name}.mp4") for camera in RIG.cameras]
    for path in paths:
        write_video(path, [np.zeros((height, width, 3), np.uint8)] * (BEFORE + POSES), FILM_FPS)
    return paths


@pytest.fixture
def take(tmp_path: Path, films: list[str]) -> Path:
    """A take of these films, whose performer stands still."""
    poses = [
        ScenePose((performer_pose(n + BEFORE, rot.identity((len(SKELETON),)), (0.2, 0.95, 0.1)),)) for n in range(POSES)
    ]
    path = write_poses(tmp_path, "filmed", [ANNA], poses)
    before = read_take_file(path)
    capture = {"source": {"kind": "videos", "paths": films}}
    setup = TakeSetup.of(RIG, [ANNA], {}, before.setup.database, capture)
    write_whole_take(path, setup, before.notes, list(before.stamped_frames), list(before.poses))
    return path


def put_on(take: Path) -> str:
    bpy.context.scene.perfanim_result.pictures = True
    assert bpy.ops.perfanim.play_take(path=str(take)) == {"FINISHED"}
    return str(take)


@pytest.mark.parametrize("resolution", [(1920, 1080), (1080, 1080), (1080, 1920)])
def test_a_camera_sees_the_character_where_the_film_has_the_performer(
    chosen: Any, take: Path, resolution: tuple[int, int]
) -> None:
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = resolution
    scene.perfanim_result.on_floor = False
    put_on(take)
    joints, _ = forward_kinematics(SKELETON, rot.identity((len(SKELETON),)), np.array([0.2, 0.95, 0.1]))
    bones = chosen.armature.pose.bones
    for camera in RIG.cameras:
        obj = bpy.data.objects[f"Perfanim {camera.name}"]
        bpy.context.view_layer.update()
        width, height = camera.image_size
        # pixels of the picture across the view, which it fits into
        across, along = (
            max(side, other * a / b)
            for side, other, a, b in ((width, height, *resolution), (height, width, *resolution[::-1]))
        )
        for bone, joint in (("head", "head"), ("foot.L", "lfoot"), ("hand.R", "rhand")):
            seen = world_to_camera_view(scene, obj, Vector(chosen.armature.matrix_world @ bones[bone].head))
            wide = (seen.x - 0.5) * across + 0.5 * (width - 1)
            high = 0.5 * (height - 1) - (seen.y - 0.5) * along
            place = joints[SKELETON.index(joint)] @ camera.rotation.T + camera.translation_m
            pixels = camera.matrix @ (place / place[2])
            np.testing.assert_allclose([wide, high], pixels[:2], atol=0.5)


@pytest.mark.parametrize("scene_fps", [24, 60])
def test_the_film_goes_with_the_motion_at_any_rate(chosen: Any, take: Path, scene_fps: int) -> None:
    scene = bpy.context.scene
    scene.render.fps = scene_fps
    scene.frame_set(11)
    put_on(take)
    data = bpy.data.objects[f"Perfanim {RIG.cameras[0].name}"].data
    for frame in (11, 12, 20, 30):
        scene.frame_set(frame)
        shown = data.evaluated_get(bpy.context.evaluated_depsgraph_get()).background_images[0].image_user
        pose = (frame - 11) * FILM_FPS / scene_fps  # as many pictures after the first
        assert frame + shown.frame_offset == pytest.approx(1 + BEFORE + pose, abs=0.51)
    scene.frame_set(400)
    shown = data.evaluated_get(bpy.context.evaluated_depsgraph_get()).background_images[0].image_user
    assert 400 + shown.frame_offset == BEFORE + POSES  # its last picture


def test_again_there_is_one_camera_of_each_name(chosen: Any, take: Path, part: Any) -> None:
    for _ in range(2):
        put_on(take)
    names = {f"Perfanim {camera.name}" for camera in RIG.cameras}
    assert {obj.name for obj in bpy.data.objects if obj.type == "CAMERA" and "Perfanim" in obj.name} == names
    assert f"pictures behind {', '.join(sorted(names))}" in part("jobs.activity").message("takes")[0]


def test_the_sound_of_a_film_goes_with_the_motion(chosen: Any, take: Path, films: list[str], part: Any) -> None:
    versions, scene = part("blender_versions"), bpy.context.scene
    put_on(take)
    assert len(versions.sequencer_strips(scene)) == 0  # films without sound
    with wave.open(films[1], "wb") as sound:  # a sound is known by its content
        sound.setparams((1, 2, 8000, 0, "NONE", ""))
        sound.writeframes(bytes(2 * 8000 * (BEFORE + POSES) // int(FILM_FPS)))
    for frame in (21, 41):
        scene.frame_set(frame)
        put_on(take)
        if not bpy.app.build_options.audaspace:  # as the module of 4.2, which can neither read nor play sounds
            assert len(versions.sequencer_strips(scene)) == 0
            continue
        (strip,) = versions.sequencer_strips(scene)
        assert strip.type == "SOUND"
        assert strip.frame_start == pytest.approx(frame - BEFORE * scene.render.fps / FILM_FPS, abs=0.51)


def test_a_film_that_is_gone_is_said_and_the_motion_is_there(
    chosen: Any, take: Path, films: list[str], part: Any
) -> None:
    Path(films[1]).unlink()
    put_on(take)
    said = part("jobs.activity").message("takes")[0]
    assert "no reference pictures: " in said and films[1] in said
    assert chosen.armature.animation_data.action is not None
