"""Adjustments of a character: kept with it, and seen on its keyed action while they are changed."""

from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest
from heroes import clip
from played import curves_of


def heights(armature_object: Any, bones: list[str]) -> np.ndarray:
    found = []
    for frame in (1, 12, 24):
        bpy.context.scene.frame_set(frame)
        posed = armature_object.evaluated_get(bpy.context.evaluated_depsgraph_get())
        found.append([posed.pose.bones[name].head.z for name in bones])
    return np.array(found)


@pytest.mark.parametrize("own", [False, True])
def test_an_adjustment_changes_the_keys_and_nothing_else(part: Any, chosen: Any, hero: Any, own: bool) -> None:
    motion = clip("walking-01-neutral", 24)
    name = part("character.create_character").create_character(bpy.context, motion.skeleton) if own else hero.name
    character = bpy.data.objects[name]
    feet = ["foot.L", "foot.R"] if own else ["mixamorig:LeftFoot", "mixamorig:RightFoot"]
    hips = ["hips"] if own else ["mixamorig:Hips"]
    frames = np.arange(1.0, 25.0)
    part("animation.actions").write_action(name, frames, motion.rotations, motion.root_positions_m, motion.skeleton)
    before, stood = heights(character, hips), heights(character, feet)
    keys = sum(len(curve.keyframe_points) for curve in curves_of(character))
    character.perfanim_character.hip_height = -60.0
    assert np.allclose(heights(character, hips), before - 0.06, atol=0.012)
    assert np.allclose(heights(character, feet), stood, atol=0.002)
    assert sum(len(curve.keyframe_points) for curve in curves_of(character)) == keys
    character.perfanim_character.hip_height = 0.0
    assert np.allclose(heights(character, hips), before, atol=0.002)
    character.perfanim_character.arm_spread = 20.0
    assert np.allclose(heights(character, feet), stood, atol=0.002)


def test_a_live_character_follows_at_once(part: Any, chosen: Any, hero: Any) -> None:
    motion = clip("walking-01-neutral", 2)
    driver = part("capture.armature_driver").ArmatureDriver(hero.name, motion.skeleton)
    places = []
    for height in (0.0, -50.0):
        hero.perfanim_character.hip_height = height
        driver.apply(motion.rotations[0], motion.root_positions_m[0])
        bpy.context.view_layer.update()
        places.append(hero.pose.bones["mixamorig:Hips"].head.z)
    assert places[0] - places[1] == pytest.approx(0.05, abs=0.01)


def test_adjustments_are_saved_with_the_character(chosen: Any, hero: Any, tmp_path: Path) -> None:
    hero.perfanim_character.foot_pitch = 4.0
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "hero.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "hero.blend"))
    assert bpy.data.objects["Hero"].perfanim_character.foot_pitch == pytest.approx(4.0)
