"""Motion on others' characters, as Blender evaluates them."""

import json
import shutil
import sys
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from heroes import at_24_fps, clip, open_hero
from perfanim.core.body.motion import Motion
from perfanim.core.body.skeleton import forward_kinematics
from perfanim.core.body.standard_skeleton import scaled
from perfanim.core.body.standing_on_floor import on_floor
from perfanim.core.cli.main import build_parser, main
from perfanim.core.errors import CharacterError
from perfanim.core.formats.motion.bvh import write_bvh
from perfanim.core.retarget.displayed_joint_names import NAMINGS
from perfanim.core.retarget.retargeter import RootMotion
from perfanim.core.system.assets import MOTION
from perfanim.perfanim_addon.capture.armature_driver import ArmatureDriver
from perfanim.perfanim_addon.character import create_character
from perfanim.perfanim_addon.export import stage
from perfanim.perfanim_addon.export.export_animation import Form
from perfanim.perfanim_addon.export.retarget_file import main as retarget_main
from perfanim.perfanim_addon.export.retarget_file import retarget_file
from played import curves_of
from retargeted import measured, played
from stood import read_back, stood

DIRECTION_DEG = 3.0
FEET_MM = 5.0
SLIDE_CM_S = 1.0


def check_played(done: dict[str, Any], motion: Motion) -> None:
    """Compare what Blender shows with the performer: where limbs point, how fast bones turn, how far feet slide."""
    found = measured(done, motion)
    for limb, errors_deg in found.direction_deg.items():
        assert np.median(errors_deg) <= DIRECTION_DEG, limb
    # a twist that flips turns a bone by up to half a turn at once; bending a knee adds a little
    assert found.turn_deg <= 2.0 * found.own_turn_deg
    assert found.standing > 10
    assert found.slide_cm_s <= found.own_slide_cm_s + SLIDE_CM_S


BLENDS = "VRM-Addon-for-Blender/tests/resources"


@pytest.mark.parametrize(
    ("rig", "name"),
    [
        ("Mixamo/Xbot.glb", "walking-01-neutral"),
        ("Mixamo/Xbot.glb", "boxing-01-neutral"),
        ("Khronos_CesiumMan/CesiumMan/glTF-Binary/CesiumMan.glb", "walking-01-neutral"),
        ("Khronos_CesiumMan/CesiumMan/glTF-Binary/CesiumMan.glb", "boxing-01-neutral"),
        ("Godot_mannequiny/ragdoll_physics/characters/mannequiny.glb", "boxing-01-neutral"),
        ("Godot_mannequiny/platformer/player/player.glb", "boxing-01-neutral"),
        (f"{BLENDS}/unity/VrmaInspector/Assets/StreamingAssets/Example.vrm", "boxing-01-neutral"),
        (f"{BLENDS}/blend/rest_a_pose_t_position_rest.blend", "boxing-01-neutral"),
        (f"{BLENDS}/blend/basic_armature.blend", "walking-01-neutral"),  # whose hips are held by the bone above
        (f"{BLENDS}/blend/multi_root_armature_vrm1.blend", "boxing-01-neutral"),
        (f"{BLENDS}/blend/pose_rotation_scale_shape_key.blend", "boxing-01-neutral"),
        (f"{BLENDS}/blend/lossy_animation/extra_intermediate_spine.blend", "boxing-01-neutral"),
    ],
)
def test_characters_of_others_move_like_the_performer(shared_dir: Path, tmp_path: Path, rig: str, name: str) -> None:
    motion = at_24_fps(clip(name, 16)) if rig.endswith(".blend") else clip(name, 16)
    done = retarget_file(motion, shared_dir / "rigs" / rig, tmp_path / "out.blend")
    assert done["doubtful"] == {}
    assert {"root", "head", "thorax", "lfoot", "rfoot", "lradius", "rradius", "ltibia"} <= done["mapped"].keys()
    assert ("lhand" in done["mapped"]) == ("player" not in rig)  # the robot's arms end in its forearms
    check_played(done, motion)


@pytest.mark.parametrize("ending", ["blend", "fbx", "glb"])
def test_a_character_that_hangs_below_its_origin_stands_on_the_floor(
    shared_dir: Path, tmp_path: Path, ending: str
) -> None:
    """Xbot's soles lie 5 cm below its origin: they stand on the floor in each format, read back."""
    motion = at_24_fps(on_floor(clip("walking-01-neutral", 30)))
    out = tmp_path / f"out.{ending}"
    done = retarget_file(motion, shared_dir / "rigs/Mixamo/Xbot.glb", out)
    done, first = (done, 1) if ending == "blend" else read_back(done, motion.fps)
    feet = stood(done, motion, first)
    assert np.abs(feet.soles_mm.min(axis=1)).max() < FEET_MM
    assert feet.slide_mm < FEET_MM


def test_a_robot_whose_heels_are_part_of_its_shins_stands_on_the_floor(shared_dir: Path, tmp_path: Path) -> None:
    motion = on_floor(clip("walking-01-neutral", 60))
    robot = shared_dir / "rigs/Godot_mannequiny/platformer/player/player.glb"
    feet = stood(retarget_file(motion, robot, tmp_path / "out.blend"), motion)
    assert np.abs(feet.soles_mm.min(axis=1)).max() < FEET_MM
    assert feet.slide_mm < FEET_MM


def test_fbx_characters_are_read(mixamo_blend: Path, tmp_path: Path) -> None:
    open_hero(mixamo_blend)
    bpy.ops.export_scene.fbx(filepath=str(tmp_path / "hero.fbx"), add_leaf_bones=False)
    motion = clip("boxing-01-neutral", 16)
    done = retarget_file(motion, tmp_path / "hero.fbx", tmp_path / "out.blend")
    assert done["mapped"]["rhand"] == "mixamorig:RightHand"
    check_played(done, motion)


def test_a_fox_is_refused_with_the_reason(shared_dir: Path, tmp_path: Path) -> None:
    with pytest.raises(CharacterError, match=r"Fox.glb: the armature is not a biped: its trunk leans 87 degrees"):
        retarget_file(
            clip("walking-01-neutral", 2), shared_dir / "rigs/Khronos_Fox_bevy/animated/Fox.glb", tmp_path / "x.blend"
        )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.long
def test_a_generated_control_rig_is_driven_by_its_controls(tmp_path: Path) -> None:
    """Rigify: limbs switched to forward kinematics, and what is measured are the deform bones at the chain's end."""
    import addon_utils

    if addon_utils.enable("rigify", default_set=True) is None:
        pytest.skip("Rigify is not here")
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    bpy.ops.object.armature_human_metarig_add()
    bpy.ops.pose.rigify_generate()
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "rig.blend"))
    motion = at_24_fps(clip("boxing-01-neutral", 8))
    root_motion = RootMotion.ROOT_BONE
    done = retarget_file(motion, tmp_path / "rig.blend", tmp_path / "out.blend", root_motion=root_motion)
    assert (done["found_by"], done["root_motion"]) == ("rigify-controls", "root bone")
    limbs = ("thigh", "shin", "foot", "toe", "upper_arm", "forearm", "hand", "f_middle.01")
    joints = ("femur", "tibia", "foot", "toes", "humerus", "radius", "hand", "fingers")
    deform = {s.lower() + j: f"DEF-{b}.{s}" for s in "LR" for j, b in zip(joints, limbs, strict=True)}
    check_played(done | {"mapped": deform}, motion)


def test_the_command_line_writes_a_file(mixamo_blend: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out.blend"
    write_bvh(clip("walking-01-neutral", 20), tmp_path / "walk.bvh")
    line = ["retarget", tmp_path / "walk.bvh", "--to", mixamo_blend, "--out", out, "--root-motion", "object"]
    capsys.readouterr()
    assert main([*map(str, line), "--json"]) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["frames"] == 20
    assert summary["mapped"]["lfemur"] == "mixamorig:LeftUpLeg"
    assert summary["found_by"] == "names"
    assert set(summary["unmapped"]) == {"lwrist", "rwrist"} - summary["mapped"].keys()
    bpy.ops.wm.open_mainfile(filepath=str(out))
    curves = curves_of(bpy.data.objects["Hero"])
    assert {curve.group.name for curve in curves} == {*summary["mapped"].values(), "Object Transforms"}
    assert "delta_location" in {curve.data_path for curve in curves}


def test_a_picture_adds_nothing_to_the_file(
    mixamo_blend: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stage, "_STAGE", stage.Stage(pixels=(48, 64), samples=1))
    write_bvh(clip("walking-01-neutral", 4), tmp_path / "walk.bvh")
    line = ["walk.bvh", "out.blend", "--to", mixamo_blend, "--render", "out.png", "--frame", "3"]
    monkeypatch.chdir(tmp_path)
    assert retarget_main([*map(str, line)]) == 0
    assert (tmp_path / "out.png").read_bytes().startswith(b"\x89PNG")
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "out.blend"))
    assert {obj.name for obj in bpy.context.scene.objects} == {"Hero", "Hero body"}  # no floor or camera


def test_the_character_comes_out_for_another_program_under_its_names(mixamo_blend: Path, tmp_path: Path) -> None:
    motion = at_24_fps(clip("walking-01-neutral", 8))
    done = retarget_file(motion, mixamo_blend, tmp_path / "walk.blend")
    wanted = played(bpy.data.objects[done["armature"]], 8, done["mapped"].values())
    done = retarget_file(motion, mixamo_blend, tmp_path / "walk.fbx", form=Form(naming="unreal"))
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.scene.render.fps = 24
    bpy.ops.import_scene.fbx(filepath=str(tmp_path / "walk.fbx"), anim_offset=0.0)
    hero = next(obj for obj in bpy.data.objects if obj.type == "ARMATURE")
    assert {other.find_armature() for other in bpy.data.objects if other.type == "MESH"} == {hero}
    names = {done["mapped"][joint]: name for joint, name in NAMINGS["unreal"].items() if joint in done["mapped"]}
    found = played(hero, 8, names.values())
    for bone, name in names.items():
        apart = np.linalg.norm(found[name][:, :3, 3] - wanted[bone][:, :3, 3], axis=1)
        assert apart.max() < 0.001, bone


def test_blender_itself_does_it_where_there_is_no_module(
    mixamo_blend: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Blender as a module plays the program: it runs the script that it is given, and talks."""
    blender = tmp_path / "blender"
    blender.write_text(
        f"#!{sys.executable}\n"
        "import os, runpy, sys\n"
        "print('Blender 0.0')\n"
        "try:\n"
        "    runpy.run_path(sys.argv[sys.argv.index('--python') + 1], run_name='__main__')\n"
        "except SystemExit as end:\n"
        "    sys.stdout.flush()\n"
        "    os._exit(end.code)\n"  # the module of 4.2 may crash when Python ends after an export
    )
    blender.chmod(0o755)
    write_bvh(clip("walking-01-neutral", 4), tmp_path / "walk.bvh")
    line = ["retarget", str(tmp_path / "walk.bvh"), "--to", str(mixamo_blend), "--blender"]
    args = build_parser(["retarget"]).parse_args([*line, str(blender), "--out", str(tmp_path / "out.glb")])
    summary = args.run(args, lambda fraction, text: None)
    assert (summary["frames"], summary["found_by"]) == (4, "names")
    assert (tmp_path / "out.glb").read_bytes().startswith(b"glTF")
    args.blender = str(tmp_path / "none")
    with pytest.raises(CharacterError, match="is not an executable"):
        args.run(args, lambda fraction, text: None)
    args.blender = None
    monkeypatch.setenv("PERFANIM_BLENDER", str(tmp_path / "of the environment"))
    with pytest.raises(CharacterError, match="of the environment: is not an executable"):
        args.run(args, lambda fraction, text: None)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("missing.glb",), "missing.glb: cannot be read (no such file)"),
        (("hero.txt",), "hero.txt: is not a character file"),
        (("hero.blend", "--map", "nobody"), "there is no bone map 'nobody'"),
        (("broken.glb",), "broken.glb: cannot be read"),
    ],
)
def test_bad_characters_are_one_line_and_no_file(
    mixamo_blend: Path, tmp_path: Path, capsys: pytest.CaptureFixture, arguments: tuple, said: str
) -> None:
    for name in ("hero.blend", "hero.txt"):
        shutil.copy(mixamo_blend, tmp_path / name)
    (tmp_path / "broken.glb").write_bytes(b"glTF\x02\x00\x00\x00nothing more")
    clip_path, target = str(MOTION / "walking-01-neutral.bvh"), tmp_path / "x.blend"
    assert retarget_main([clip_path, str(target), "--to", str(tmp_path / arguments[0]), *arguments[1:]]) == 1
    assert said in capsys.readouterr().err.splitlines()[-1]
    assert not target.exists()


def test_a_character_with_the_products_names_and_other_legs_stands_where_the_performer_does() -> None:
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    motion = clip("walking-01-neutral", 40)
    factors = np.ones(len(motion.skeleton))
    factors[[motion.skeleton.index(side + "tibia") for side in "lr"]] = 1.2  # thighs a fifth longer
    name = create_character.create_character(bpy.context, scaled(motion.skeleton, factors))
    driver = ArmatureDriver(name, motion.skeleton)
    toes = []
    for rotations, root in zip(motion.rotations, motion.root_positions_m, strict=True):
        driver.apply(rotations, root)
        bpy.context.view_layer.update()
        toes.append([np.array(bpy.data.objects[name].pose.bones["toes." + side].head) for side in "LR"])
    positions, _ = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)
    own = positions[:, [motion.skeleton.index(side + "toes") for side in "lr"]]
    speeds = [
        100.0 * motion.fps * np.linalg.norm(np.diff(feet, axis=0), axis=-1) for feet in (np.array(toes) / 1.1, own)
    ]
    standing = speeds[1] < 15.0
    assert np.count_nonzero(standing) > 10
    assert np.mean(speeds[0][standing]) <= np.mean(speeds[1][standing]) + SLIDE_CM_S
