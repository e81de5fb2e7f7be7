"""What is told about an installation, also when a part of it is broken, and the self-test."""

import importlib
import importlib.util
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import addon_utils
import bpy
import numpy as np
import pytest
from perfanim.core.system.assets import MOTION

PATIENCE_S = 300.0


@pytest.fixture
def fresh(extension: str) -> Iterator[str]:
    """The add-on switched off, to be imported anew."""

    def forget() -> None:
        for name in [name for name in sys.modules if name.startswith(extension)]:
            del sys.modules[name]

    forget()
    yield extension
    addon_utils.disable(extension, default_set=True)
    forget()


@pytest.mark.parametrize("library", ["numpy", "cv2"])
def test_without_a_library_preferences_and_diagnostics_remain(
    fresh: str, library: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, library, None)
    assert addon_utils.enable(fresh, default_set=True) is not None
    diagnostics = sys.modules[f"{fresh}.perfanim_addon.preferences.diagnostics"]
    assert library in diagnostics.problem
    lines = diagnostics.lines("4.5")
    assert f"{library} missing" in lines
    assert any(line.startswith("Problem") and library in line for line in lines)
    assert bpy.context.preferences.addons[fresh].preferences.tab == "Perfanim"
    assert set(dir(bpy.ops.perfanim)) == {"copy_diagnostics"}
    assert bpy.ops.perfanim.copy_diagnostics() == {"FINISHED"}
    assert hasattr(bpy.types, "PERFANIM_PT_broken")
    addon_utils.disable(fresh, default_set=True)
    assert not hasattr(bpy.types, "PERFANIM_PT_broken")


def test_whatever_a_broken_library_raises_is_told(fresh: str, monkeypatch: pytest.MonkeyPatch) -> None:
    class Broken:
        def find_spec(self, name: str, path: object = None, target: object = None) -> None:
            if name == "cv2":
                raise ValueError("numpy.dtype size changed, may indicate binary incompatibility")

    for name in [name for name in sys.modules if name == "cv2" or name.startswith("cv2.")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr(sys, "meta_path", [Broken(), *sys.meta_path])
    assert addon_utils.enable(fresh, default_set=True) is not None
    assert "numpy.dtype size changed" in sys.modules[f"{fresh}.perfanim_addon.preferences.diagnostics"].problem
    assert set(dir(bpy.ops.perfanim)) == {"copy_diagnostics"}


def test_a_library_that_is_there_but_does_not_load_is_told_in_the_copy(
    addon: ModuleType, extension: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    diagnostics = importlib.import_module(f"{extension}.perfanim_addon.preferences.diagnostics")
    assert diagnostics.library_facts("numpy").startswith(f"numpy {np.__version__} in ")
    real = importlib.import_module

    def broken(name: str) -> ModuleType:
        if name == "cv2":
            raise ImportError("DLL load failed while importing cv2")
        return real(name)

    monkeypatch.setattr(diagnostics.importlib, "import_module", broken)
    lines = diagnostics.lines("4.5", load=True)
    assert "cv2 cannot be loaded: ImportError: DLL load failed while importing cv2" in lines
    assert not any("cannot be loaded" in line for line in diagnostics.lines("4.5"))


def run(test: Any) -> None:
    limit = time.monotonic() + PATIENCE_S
    try:
        while not test.ended:
            test.tick()
            assert time.monotonic() < limit, test.text
            time.sleep(0.02)
    finally:
        test.close()


@pytest.fixture
def self_test(addon: ModuleType, extension: str) -> Any:
    return importlib.import_module(f"{extension}.perfanim_addon.capture.self_test_run")


def test_the_self_test_captures_the_simulated_performer(self_test: Any, part: Any, tmp_path: Path) -> None:
    database = str(tmp_path / "some.pfdb")
    build = ["database", "build", *map(str, MOTION.glob("transition-*.bvh")), "--out", database]
    first = self_test.Job("Building", self_test.PANEL, self_test.command(build), None)
    test = self_test.SelfTest(database, first, None)
    run(test)
    libraries, cameras, capture = test.lines
    assert f"numpy {np.__version__}" in libraries
    assert cameras.startswith("Cameras found: ")
    poses, good = (int(word) for word in capture.split() if word.isdigit())
    assert poses >= self_test.TUNING.tested_poses
    assert good > 0.9 * poses
    said = part("operators.self_test_operator").PERFANIM_OT_self_test.on_result(None, None, test.summary)
    assert said == "everything works" + ("" if test.summary["cameras"] else ", but there is no camera yet")


def test_the_self_test_tells_what_does_not_work(self_test: Any, tmp_path: Path) -> None:
    (tmp_path / "bad.pfdb").write_bytes(b"no database")
    test = self_test.SelfTest(str(tmp_path / "bad.pfdb"), None, None)
    with pytest.raises(self_test.CaptureError, match=r"bad\.pfdb"):
        run(test)
    assert len(test.lines) == 2, "what works is told"
