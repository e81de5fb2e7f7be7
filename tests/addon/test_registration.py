import importlib
from dataclasses import astuple
from types import ModuleType

import bpy
import pytest
from remains import remains

TIMES = 100


def test_on_and_off_a_hundred_times_leaves_nothing_and_says_nothing(
    extension: str, capfd: pytest.CaptureFixture[str]
) -> None:
    import addon_utils

    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    before = remains()
    assert not {"types", "operators", "properties", "classes", "drawn", "timers", "keys"} & set(before)
    capfd.readouterr()
    for _ in range(TIMES):
        assert addon_utils.enable(extension, default_set=True) is not None
        assert "start_capture" in dir(bpy.ops.perfanim)
        assert bpy.context.scene.perfanim.source == "SIMULATED"
        addon_utils.disable(extension, default_set=True)
    assert remains() == before
    assert "".join(capfd.readouterr()) == ""


def test_what_is_looked_for_is_there_while_the_addon_is_on(addon: ModuleType) -> None:
    found = remains()
    assert {"PERFANIM_PT_capture", "PERFANIM_PG_settings", "PERFANIM_OT_start_capture"} <= set(found["classes"])
    assert {"Scene.perfanim", "Object.perfanim_character", "WindowManager.perfanim_takes"} <= set(found["properties"])
    assert any("draw_offer" in line for line in found["drawn"])
    assert any("perfanim" in name for name in found["handlers"]["load_pre"])


def test_all_panels_move_to_the_tab_of_the_preferences(addon: ModuleType, extension: str) -> None:
    def tabs() -> set[str]:
        ours = [panel for panel in bpy.types.Panel.__subclasses__() if panel.__name__.startswith("PERFANIM_PT_")]
        shown = [panel for panel in ours if getattr(panel, "is_registered", False)]
        assert len(shown) > 7
        return {panel.bl_category for panel in shown}

    preferences = bpy.context.preferences.addons[extension].preferences
    assert preferences.tab == "Perfanim"
    preferences.tab = "Mocap"
    assert tabs() == {"Mocap"}
    preferences.tab = ""
    assert tabs() == {"Perfanim"}


def test_what_the_cameras_are_told_is_kept_in_the_preferences(addon: ModuleType, extension: str) -> None:
    left = bpy.context.preferences.addons[extension].preferences.left_camera
    setup = importlib.import_module(f"{extension}.perfanim_addon.capture.capture_request")
    settings = bpy.context.scene.perfanim
    settings.source = "CAMERAS"
    try:
        told = setup.source(settings).controls
        assert [astuple(each) for each in told] == [(None, None, None)] * 2
        left.exposure_auto, left.exposure_ms = False, 2.5
        left.gain_auto, left.gain = False, 12.0
        told = setup.source(settings).controls
        assert told[0].exposure_s == pytest.approx(0.0025) and told[0].gain == 12.0
        assert told[0].focus is None and told[1].exposure_s is None
    finally:
        left.exposure_auto = left.gain_auto = True
        settings.source = "SIMULATED"
