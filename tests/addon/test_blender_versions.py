"""What differs between versions of Blender behaves the same on each: one test for each function."""

from typing import Any

import bpy
import numpy as np
import pytest

PATH = "rotation_quaternion"


@pytest.fixture
def versions(part: Any) -> Any:
    return part("blender_versions")


@pytest.fixture
def hero(addon: object) -> bpy.types.Object:
    """An object in the scene."""
    obj = bpy.data.objects.new("Hero", None)
    bpy.context.scene.collection.objects.link(obj)
    obj.rotation_mode = "QUATERNION"
    return obj


@pytest.fixture
def action(versions: Any, hero: bpy.types.Object) -> bpy.types.Action:
    """An action with one curve: W falls from 1 to 0 in frames 1 to 11."""
    action = bpy.data.actions.new("Turn")
    curve = versions.new_curve(versions.new_channels(action, hero), PATH, 0, "Hips")
    for frame, value in ((1.0, 1.0), (11.0, 0.0)):
        curve.keyframe_points.insert(frame, value).interpolation = "LINEAR"
    return action


def shown(hero: bpy.types.Object, frame: int) -> float:
    bpy.context.scene.frame_set(frame)
    return float(hero.rotation_quaternion[0])


def test_a_new_curve_has_its_path_component_and_group(versions: Any, action: bpy.types.Action) -> None:
    (curve,) = versions.curves_of(action, versions.first_slot(action))
    assert (curve.data_path, curve.array_index, curve.group.name) == (PATH, 0, "Hips")
    assert versions.by_channel([curve]) == {(PATH, 0): curve}
    (channels,) = versions.channels_of(action, versions.first_slot(action))
    second = versions.new_curve(channels, PATH, 1, "Hips")
    assert [each.array_index for each in channels.fcurves] == [0, 1]
    assert second.group == curve.group or second.group.name == "Hips"


def test_an_assigned_action_moves_the_object_and_the_one_before_stays(
    versions: Any, hero: bpy.types.Object, action: bpy.types.Action
) -> None:
    assert versions.action_curves(hero) == []
    before = bpy.data.actions.new("Before")
    animation = hero.animation_data_create()
    animation.action = before
    versions.assign(animation, action)
    assert before.use_fake_user
    assert versions.slot_of(animation) == versions.first_slot(action)
    assert [curve.array_index for curve in versions.action_curves(hero)] == [0]
    assert shown(hero, 6) == pytest.approx(0.5)
    versions.detach_action(animation)
    assert animation.action is None
    assert action.use_fake_user


def test_an_action_is_played_alone_and_what_was_played_comes_back(
    versions: Any, hero: bpy.types.Object, action: bpy.types.Action
) -> None:
    assert versions.played(hero) is None
    versions.play_only(hero, action)
    assert shown(hero, 6) == pytest.approx(0.5)
    versions.play(hero, None)
    assert hero.animation_data is None
    versions.assign(hero.animation_data_create(), action)
    before = versions.played(hero)
    versions.play_only(hero, bpy.data.actions.new("Other"))
    assert not hero.animation_data.use_nla
    versions.play(hero, before)
    assert (hero.animation_data.action, hero.animation_data.use_nla) == (action, True)
    assert shown(hero, 11) == pytest.approx(0.0)


def test_the_slot_of_a_strip_is_set(versions: Any, hero: bpy.types.Object, action: bpy.types.Action) -> None:
    strip = hero.animation_data_create().nla_tracks.new().strips.new("Turn", 1, action)
    versions.set_slot(strip, None)  # Blender's own choice
    versions.set_slot(strip, versions.first_slot(action))
    assert versions.slot_of(strip) == versions.first_slot(action)
    assert shown(hero, 6) == pytest.approx(0.5)


def test_the_selection_of_a_bone_is_read(versions: Any, addon: object) -> None:
    assert bpy.ops.perfanim.add_character("EXEC_DEFAULT") == {"FINISHED"}
    armature = bpy.context.scene.perfanim.armature
    bpy.context.view_layer.objects.active = armature
    bpy.ops.object.mode_set(mode="POSE")
    bpy.ops.pose.select_all(action="DESELECT")
    assert not any(map(versions.is_selected, armature.pose.bones))
    bpy.ops.pose.select_all(action="SELECT")
    assert all(map(versions.is_selected, armature.pose.bones))
    bpy.ops.object.mode_set(mode="OBJECT")


def test_nodes_are_enabled(versions: Any, addon: object) -> None:
    material = bpy.data.materials.new("Shirt")
    versions.enable_nodes(material)
    assert material.node_tree is not None
    assert [node.type for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED"] == ["BSDF_PRINCIPLED"]


def test_options_of_textures_are_known_to_this_version(versions: Any, addon: object) -> None:
    from gpu_extras.presets import draw_texture_2d

    known = draw_texture_2d.__code__.co_varnames
    assert set(versions.texture_options()) <= set(known)
    assert np.all(list(versions.texture_options().values()))


def test_files_may_be_dropped_on_the_viewport_only(part: Any, addon: object) -> None:
    handler = part("operators.import_takes").PERFANIM_FH_import
    endings = handler.bl_file_extensions.split(";")
    assert {".c3d", ".trc", ".npz", ".perftake", ".mp4", ".jpg", ".yaml"} <= set(endings)
    assert len(endings) == len(set(endings))
    area = next(area for area in bpy.context.window_manager.windows[0].screen.areas if area.type == "VIEW_3D")
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[0], area=area):
        assert handler.poll_drop(bpy.context)
    other = next(area for area in bpy.context.window_manager.windows[0].screen.areas if area.type != "VIEW_3D")
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[0], area=other):
        assert not handler.poll_drop(bpy.context)
