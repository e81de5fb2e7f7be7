"""Motion on others' characters, as Blender evaluates them; and the bone map in the add-on."""

import json
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import bpy
import numpy as np
import pytest
from mathutils import Matrix
from perfanim.core.assets import MOTION
from perfanim.core.cli.main import build_parser
from perfanim.core.errors import CharacterError
from perfanim.core.formats.bvh import write_bvh
from perfanim.core.formats.naming import NAMINGS
from perfanim.core.motion import Motion, sliced
from perfanim.core.motion_files import read_motion
from perfanim.core.product_skeleton import default_skeleton, scaled
from perfanim.core.retarget.transfer import RootMotion
from perfanim.core.skeleton import forward_kinematics
from perfanim.perfanim_addon import character
from perfanim.perfanim_addon.actions import write_action
from perfanim.perfanim_addon.armature_driver import ArmatureDriver
from perfanim.perfanim_addon.export_animation import Form
from perfanim.perfanim_addon.retarget_file import main as retarget_main
from perfanim.perfanim_addon.retarget_file import retarget_file
from played import curves_of
from retargeted import measured, played

DIRECTION_DEG = 3.0
SLIDE_CM_S = 1.0
MIXAMO = {
    "root": "Hips", "lowerback": "Spine", "upperback": "Spine1", "thorax": "Spine2", "lowerneck": "Neck",
    "upperneck": "Neck1", "head": "Head", "clavicle": "Shoulder", "humerus": "Arm", "radius": "ForeArm",
    "hand": "Hand", "fingers": "HandMiddle1", "thumb": "HandThumb1", "femur": "UpLeg", "tibia": "Leg",
    "foot": "Foot", "toes": "ToeBase",
}  # fmt: skip


def clip(name: str, frames: int = 60) -> Motion:
    return sliced(read_motion(MOTION / f"{name}.bvh"), 0, frames)


def at_24_fps(motion: Motion) -> Motion:
    """A .blend keeps the rate of its scene: slower, each frame falls on one of the scene's."""
    return Motion(motion.name, 24.0, motion.skeleton, motion.rotations, motion.root_positions_m)


@pytest.fixture(scope="module")
def mixamo_blend(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A character with other names."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    name = character.create_character(bpy.context, default_skeleton(), "Hero")
    for bone in bpy.data.objects[name].data.bones:
        side = {"l": "Left", "r": "Right"}.get(bone.name[0], "") if bone.name[1:] in MIXAMO else ""
        bone.name = "mixamorig:" + side + MIXAMO.get(bone.name if not side else bone.name[1:], bone.name)
    path = tmp_path_factory.mktemp("hero") / "hero.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


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


def test_fbx_characters_are_read(mixamo_blend: Path, tmp_path: Path) -> None:
    bpy.ops.wm.open_mainfile(filepath=str(mixamo_blend))
    bpy.ops.export_scene.fbx(filepath=str(tmp_path / "hero.fbx"), add_leaf_bones=False)
    motion = clip("boxing-01-neutral", 16)
    done = retarget_file(motion, tmp_path / "hero.fbx", tmp_path / "out.blend")
    assert done["mapped"]["rhand"] == "mixamorig:RightHand"
    check_played(done, motion)


def test_a_fox_is_refused_with_the_reason(shared_dir: Path, tmp_path: Path) -> None:
    with pytest.raises(CharacterError, match=r"Fox.glb: it is no biped: its trunk leans 87 degrees"):
        retarget_file(
            clip("walking-01-neutral", 2), shared_dir / "rigs/Khronos_Fox_bevy/animated/Fox.glb", tmp_path / "x.blend"
        )
    assert list(tmp_path.iterdir()) == []


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


def test_the_command_line_writes_a_file(mixamo_blend: Path, tmp_path: Path) -> None:
    out = tmp_path / "out.blend"
    write_bvh(clip("walking-01-neutral", 20), tmp_path / "walk.bvh")
    command = [sys.executable, "-m", "perfanim.core.cli.main", "retarget", str(tmp_path / "walk.bvh")]
    done = subprocess.run(
        [
            *command,
            "--to",
            str(mixamo_blend),
            "--out",
            str(out),
            "--root-motion",
            "object",
            "--json",
            *("--render", str(out.with_suffix(".png"))),
        ],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    summary = json.loads(done.stdout)
    assert summary["frames"] == 20
    assert summary["mapped"]["lfemur"] == "mixamorig:LeftUpLeg"
    assert summary["found_by"] == "names"
    assert set(summary["unmapped"]) == {"lwrist", "rwrist"} - summary["mapped"].keys()
    assert out.with_suffix(".png").read_bytes().startswith(b"\x89PNG")
    bpy.ops.wm.open_mainfile(filepath=str(out))
    assert {obj.name for obj in bpy.context.scene.objects} == {"Hero", "Hero body"}  # no floor or camera of the picture
    curves = curves_of(bpy.data.objects["Hero"])
    assert {curve.group.name for curve in curves} == {*summary["mapped"].values(), "Object Transforms"}
    assert "delta_location" in {curve.data_path for curve in curves}


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
    with pytest.raises(CharacterError, match="is no program"):
        args.run(args, lambda fraction, text: None)
    args.blender = None
    monkeypatch.setenv("PERFANIM_BLENDER", str(tmp_path / "of the environment"))
    with pytest.raises(CharacterError, match="of the environment: is no program"):
        args.run(args, lambda fraction, text: None)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("missing.glb",), "missing.glb: cannot be read (no such file)"),
        (("hero.txt",), "hero.txt: is no character file"),
        (("hero.blend", "--map", "nobody"), "there is no bone map 'nobody'"),
        (("broken.glb",), "broken.glb: cannot be read"),
    ],
)
def test_bad_input_is_one_line_and_no_file(
    mixamo_blend: Path, tmp_path: Path, capsys: pytest.CaptureFixture, arguments: tuple, said: str
) -> None:
    for name in ("hero.blend", "hero.txt"):
        shutil.copy(mixamo_blend, tmp_path / name)
    (tmp_path / "broken.glb").write_bytes(b"glTF\x02\x00\x00\x00nothing more")
    clip_path, target = str(MOTION / "walking-01-neutral.bvh"), tmp_path / "x.blend"
    assert retarget_main([clip_path, str(tmp_path / arguments[0]), str(target), *arguments[1:]]) == 1
    assert said in capsys.readouterr().err.splitlines()[-1]
    assert not target.exists()


@pytest.mark.parametrize("root_motion", list(RootMotion))
def test_live_poses_are_the_recorded_ones(mixamo_blend: Path, addon: ModuleType, root_motion: RootMotion) -> None:
    bpy.ops.wm.open_mainfile(filepath=str(mixamo_blend))
    hero = bpy.data.objects["Hero"]
    hero.location, hero.rotation_euler, hero.scale = (1.0, 2.0, 0.5), (0.0, 0.0, 0.7), (2.0, 2.0, 2.0)
    chosen = bpy.context.scene.perfanim
    chosen.armature = hero
    hero.perfanim_character.root_motion = root_motion.name
    motion = clip("boxing-01-neutral", 8)
    actions = sys.modules[f"{addon.__name__}.perfanim_addon.actions"]
    drivers = sys.modules[f"{addon.__name__}.perfanim_addon.armature_driver"]
    actions.write_action("Hero", np.arange(1.0, 9.0), motion.rotations, motion.root_positions_m, motion.skeleton)
    recorded = played(hero, 8, [bone.name for bone in hero.pose.bones])
    hero.animation_data.action = None
    driver = drivers.ArmatureDriver("Hero", motion.skeleton)
    for frame in range(8):
        driver.apply(motion.rotations[frame], motion.root_positions_m[frame])
        bpy.context.view_layer.update()
        for bone in hero.pose.bones:
            live = np.array(hero.matrix_world @ bone.matrix)
            assert np.allclose(live, recorded[bone.name][frame], atol=1e-4), bone.name


def stood(hero: bpy.types.Object, own: tuple, above: tuple) -> None:
    """Give a character a scale and a turned parent with a scale of its own."""
    parent = bpy.data.objects.new("Group", None)
    bpy.context.scene.collection.objects.link(parent)
    hero.parent = parent
    parent.location, parent.rotation_euler, parent.scale = (0.3, -1.0, 0.0), (0.4, -0.3, 0.7), above
    hero.location, hero.rotation_euler, hero.scale = (1.0, 2.0, 0.5), (0.2, 0.5, -0.4), own
    bpy.context.view_layer.update()


@pytest.mark.parametrize(
    ("own", "above", "said"),
    [
        ((1.0, 1.0, 2.0), (1.0, 1.0, 1.0), "stretched, 2 times longer"),
        ((1.0, 1.0, 1.0), (3.0, 1.0, 1.0), "stretched, 3 times longer"),
        ((-1.0, 1.0, 1.0), (1.0, 1.0, 1.0), "mirrored"),
        ((2.0, 2.0, 2.0), (-1.0, -1.0, -1.0), "mirrored"),
    ],
)
def test_a_character_that_the_scene_shows_distorted_is_refused_with_what_to_do(
    mixamo_blend: Path, addon: ModuleType, own: tuple, above: tuple, said: str
) -> None:
    bpy.ops.wm.open_mainfile(filepath=str(mixamo_blend))
    hero, chosen = bpy.data.objects["Hero"], bpy.context.scene.perfanim
    states = sys.modules[f"{addon.__name__}.perfanim_addon.states"]
    chosen.armature = hero
    hero.perfanim_character.joints["head"].bone = "mixamorig:Neck1"  # by hand
    stood(hero, own, above)
    assert said in states.character(chosen).problem
    chosen.armature = hero
    assert hero.perfanim_character.joints["head"].bone == "mixamorig:Neck1"
    for name in ("Hero", character.create_character(bpy.context, default_skeleton())):
        obj = bpy.data.objects[name]
        obj.parent, obj.matrix_basis = hero.parent, hero.matrix_basis
        bpy.context.view_layer.update()
        with pytest.raises(CharacterError, match=rf"{name}: .*{said}.*Object > Apply > Scale"):
            ArmatureDriver(name, default_skeleton())


@pytest.mark.parametrize("root_motion", list(RootMotion))
@pytest.mark.parametrize("own", [(1.5, 1.5, 1.5), (-1.5, 1.5, -1.5)])
def test_joints_are_where_the_scene_s_scale_puts_them(
    mixamo_blend: Path, addon: ModuleType, own: tuple, root_motion: RootMotion
) -> None:
    """As on the character without scale and place, brought into the scene as a whole; two negative scales turn it."""
    bpy.ops.wm.open_mainfile(filepath=str(mixamo_blend))
    hero, motion = bpy.data.objects["Hero"], clip("boxing-01-neutral", 8)
    hero.perfanim_character.root_motion = root_motion.name
    drivers = sys.modules[f"{addon.__name__}.perfanim_addon.armature_driver"]

    def joints() -> np.ndarray:
        drivers.ArmatureDriver("Hero", motion.skeleton).apply(motion.rotations[7], motion.root_positions_m[7])
        bpy.context.view_layer.update()
        return np.array([hero.matrix_world @ bone.head for bone in hero.pose.bones])

    hero.data.transform(Matrix.Rotation(0.5, 4, "X"))  # its own up is not the scene's
    alone = joints()
    hero.delta_location, hero.delta_rotation_quaternion = (0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)
    stood(hero, own, (0.2, 0.2, 0.2))
    place = np.array(hero.matrix_world)
    assert np.allclose(joints(), alone @ place[:3, :3].T + place[:3, 3], atol=1e-4)


def test_lengths_and_joints_that_an_earlier_animation_has_left_are_brought_to_rest(mixamo_blend: Path) -> None:
    """As importers leave the pose of one of the animations in a file."""
    motion, shown = clip("boxing-01-neutral", 2), []
    for left in (False, True):
        for live in (False, True):
            bpy.ops.wm.open_mainfile(filepath=str(mixamo_blend))
            hero = bpy.data.objects["Hero"]
            for name in ("LeftUpLeg", "RightForeArm", "Hips", "Spine1") if left else ():
                bone = hero.pose.bones[f"mixamorig:{name}"]
                bone.scale, bone.location = (1.0, 1.1, 0.9), (0.02, 0.01, -0.03)
            if live:
                ArmatureDriver("Hero", motion.skeleton).apply(motion.rotations[1], motion.root_positions_m[1])
            else:
                poses = (motion.rotations, motion.root_positions_m, motion.skeleton)
                write_action("Hero", [1.0, 2.0], *poses)
                bpy.context.scene.frame_set(2)
            bpy.context.view_layer.update()
            shown.append([np.array(bone.matrix) for bone in hero.pose.bones])
    for other in shown[1:]:
        assert np.allclose(shown[0], other, atol=1e-5)


def test_the_map_is_found_when_an_armature_is_chosen_and_can_be_edited(mixamo_blend: Path, addon: ModuleType) -> None:
    bpy.ops.wm.open_mainfile(filepath=str(mixamo_blend))
    hero, chosen = bpy.data.objects["Hero"], bpy.context.scene.perfanim
    states = sys.modules[f"{addon.__name__}.perfanim_addon.states"]
    chosen.armature = hero
    kept = hero.perfanim_character
    assert kept.origin == "names"
    entry = kept.joints["lhand"]
    assert (entry.bone, entry.state) == ("mixamorig:LeftHand", "mapped")
    entry.bone = "mixamorig:LeftForeArm"
    assert kept.joints["lhand"].state == "doubtful"
    assert "lradius" in kept.joints["lhand"].reason
    chosen.armature = None
    chosen.armature = hero
    assert kept.joints["lhand"].bone == "mixamorig:LeftForeArm"
    assert states.character(chosen).ready
    kept.joints["lfemur"].bone = ""
    assert "no bone is given for lfemur" in states.character(chosen).problem
    assert len(kept.joints) == 29  # still there to be mended
    kept.joints["lfemur"].bone = "mixamorig:LeftUpLeg"
    assert states.character(chosen).ready
    assert bpy.ops.perfanim.find_bones() == {"FINISHED"}
    assert hero.perfanim_character.joints["lhand"].state == "mapped"


def test_use_active_finds_the_armature_of_what_an_importer_leaves_active(mixamo_blend: Path, addon: ModuleType) -> None:
    bpy.ops.wm.open_mainfile(filepath=str(mixamo_blend))
    hero, chosen, layer = bpy.data.objects["Hero"], bpy.context.scene.perfanim, bpy.context.view_layer
    group, part = (bpy.data.objects.new(name, None) for name in ("Group", "Part"))
    for empty in (group, part):
        bpy.context.scene.collection.objects.link(empty)
    hero.parent, part.parent = group, hero
    for active in (bpy.data.objects["Hero body"], group, part):
        layer.objects.active, chosen.armature = active, None
        assert bpy.ops.perfanim.use_active_armature() == {"FINISHED"}
        assert chosen.armature == hero
    second = bpy.data.objects.new("Second", hero.data)
    bpy.context.scene.collection.objects.link(second)
    second.parent, layer.objects.active = group, group
    with pytest.raises(RuntimeError, match="2 armatures hang on Group"):
        bpy.ops.perfanim.use_active_armature()


def test_bone_maps_are_kept_and_loaded(mixamo_blend: Path, addon: ModuleType) -> None:
    bpy.ops.wm.open_mainfile(filepath=str(mixamo_blend))
    hero, chosen = bpy.data.objects["Hero"], bpy.context.scene.perfanim
    chosen.armature = hero
    kept = hero.perfanim_character
    kept.joints["head"].bone = "mixamorig:Neck1"
    assert bpy.ops.perfanim.save_bone_map(name="Long neck") == {"FINISHED"}
    kept.joints["head"].bone = "mixamorig:Head"
    assert bpy.ops.perfanim.load_bone_map(preset="Long_neck") == {"FINISHED"}
    assert kept.joints["head"].bone == "mixamorig:Neck1"
    chosen.armature = None
    kept.joints.clear()
    chosen.armature = hero  # what the user has kept for a rig comes before what is found
    assert (kept.origin, kept.joints["head"].bone) == ("Long_neck", "mixamorig:Neck1")
    place = sys.modules[f"{addon.__name__}.perfanim_addon.place"]
    (place.user_folder("bone_maps") / "Long_neck.toml").unlink()


def test_the_active_bone_is_picked(mixamo_blend: Path, addon: ModuleType) -> None:
    bpy.ops.wm.open_mainfile(filepath=str(mixamo_blend))
    hero, chosen = bpy.data.objects["Hero"], bpy.context.scene.perfanim
    chosen.armature = hero
    kept = hero.perfanim_character
    kept.active = list(kept.joints.keys()).index("head")
    hero.data.bones.active = hero.data.bones["mixamorig:Neck"]
    assert bpy.ops.perfanim.pick_bone() == {"FINISHED"}
    assert kept.joints["head"].bone == "mixamorig:Neck"


def test_the_t_pose_shows_whether_limbs_are_mapped_right(mixamo_blend: Path, addon: ModuleType) -> None:
    bpy.ops.wm.open_mainfile(filepath=str(mixamo_blend))
    armature_object = bpy.data.objects["Hero"]
    bpy.context.scene.perfanim.armature = armature_object
    bones = {entry.name: entry.bone for entry in armature_object.perfanim_character.joints}

    def way(start: str, end: str) -> np.ndarray:
        posed = armature_object.evaluated_get(bpy.context.evaluated_depsgraph_get()).pose.bones
        heads = [np.array(armature_object.matrix_world @ posed[bones[joint]].head) for joint in (start, end)]
        return (heads[1] - heads[0]) / np.linalg.norm(heads[1] - heads[0])

    for bone in armature_object.pose.bones:  # somehow
        bone.rotation_mode = "QUATERNION"
        bone.rotation_quaternion = (0.9, 0.3, -0.2, 0.2)
    assert bpy.ops.perfanim.show_t_pose() == {"FINISHED"}
    for start, end, wanted in (
        ("lhumerus", "lradius", (1.0, 0.0, 0.0)),
        ("rradius", "rhand", (-1.0, 0.0, 0.0)),
        ("lfemur", "ltibia", (0.0, 0.0, -1.0)),
        ("rtibia", "rfoot", (0.0, 0.0, -1.0)),
    ):
        assert np.degrees(np.arccos(way(start, end) @ wanted)) < 12.0, start  # thighs stand apart a little


def test_a_character_with_the_products_names_and_other_legs_stands_where_the_performer_does() -> None:
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    motion = clip("walking-01-neutral", 40)
    factors = np.ones(len(motion.skeleton))
    factors[[motion.skeleton.index(side + "tibia") for side in "lr"]] = 1.2  # thighs a fifth longer
    name = character.create_character(bpy.context, scaled(motion.skeleton, factors))
    driver = ArmatureDriver(name, motion.skeleton)
    toes = []
    for rotations, root in zip(motion.rotations, motion.root_positions_m, strict=True):
        driver.apply(rotations, root)
        bpy.context.view_layer.update()
        toes.append([np.array(bpy.data.objects[name].pose.bones[side + "toes"].head) for side in "lr"])
    positions, _ = forward_kinematics(motion.skeleton, motion.rotations, motion.root_positions_m)
    own = positions[:, [motion.skeleton.index(side + "toes") for side in "lr"]]
    speeds = [
        100.0 * motion.fps * np.linalg.norm(np.diff(feet, axis=0), axis=-1) for feet in (np.array(toes) / 1.1, own)
    ]
    standing = speeds[1] < 15.0
    assert np.count_nonzero(standing) > 10
    assert np.mean(speeds[0][standing]) <= np.mean(speeds[1][standing]) + SLIDE_CM_S


def test_inverse_kinematics_does_not_pull_against_the_motion(mixamo_blend: Path) -> None:
    motion = clip("boxing-01-neutral", 8)
    shown = []
    for with_ik in (False, True):
        bpy.ops.wm.open_mainfile(filepath=str(mixamo_blend))
        hero = bpy.data.objects["Hero"]
        if with_ik:
            holder = bpy.data.objects.new("holder", None)
            bpy.context.scene.collection.objects.link(holder)
            constraint = hero.pose.bones["mixamorig:LeftForeArm"].constraints.new("IK")
            constraint.target, constraint.chain_count = holder, 2
        ArmatureDriver("Hero", motion.skeleton).apply(motion.rotations[5], motion.root_positions_m[5])
        bpy.context.view_layer.update()
        shown.append([np.array(bone.matrix) for bone in hero.pose.bones])
    assert np.allclose(shown[0], shown[1], atol=1e-5)


def test_a_held_bone_is_told(mixamo_blend: Path) -> None:
    bpy.ops.wm.open_mainfile(filepath=str(mixamo_blend))
    hero = bpy.data.objects["Hero"]
    holder = bpy.data.objects.new("holder", None)
    bpy.context.scene.collection.objects.link(holder)
    constraint = hero.pose.bones["mixamorig:LeftHand"].constraints.new("COPY_ROTATION")
    constraint.target = holder
    with pytest.raises(CharacterError, match="constraints hold the bone 'mixamorig:LeftHand'"):
        ArmatureDriver("Hero", default_skeleton())


def test_a_linked_rig_is_driven_through_its_override(mixamo_blend: Path, addon: ModuleType, tmp_path: Path) -> None:
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    with bpy.data.libraries.load(str(mixamo_blend), link=True) as (_, wanted):
        wanted.objects = ["Hero"]
    linked = bpy.data.objects["Hero"]
    bpy.context.scene.collection.objects.link(linked)
    chosen = bpy.context.scene.perfanim
    chosen.armature = linked
    states = sys.modules[f"{addon.__name__}.perfanim_addon.states"]
    assert "make a library override" in states.character(chosen).problem
    own = linked.override_hierarchy_create(bpy.context.scene, bpy.context.view_layer, do_fully_editable=True)
    chosen.armature = own
    assert states.character(chosen).ready
    motion = clip("boxing-01-neutral", 4)
    actions = sys.modules[f"{addon.__name__}.perfanim_addon.actions"]
    actions.write_action(own.name, np.arange(1.0, 5.0), motion.rotations, motion.root_positions_m, motion.skeleton)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "shot.blend"))
    again = bpy.context.scene.perfanim.armature
    assert again.override_library is not None
    assert states.character(bpy.context.scene.perfanim).ready
    assert len(curves_of(again)) > 100
