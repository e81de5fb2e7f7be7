"""The command line as `blender --command perfanim` runs it, in a process of its own."""

import importlib
from pathlib import Path
from types import ModuleType

import pytest


def test_exit_status_and_output_are_those_of_the_command(
    addon: ModuleType, extension: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    run = importlib.import_module(f"{extension}.perfanim_addon.operators.command_line_operators").run
    assert run(["--version"]) == 0
    assert capfd.readouterr().out.startswith("perfanim ")
    assert run(["database", "info", str(tmp_path / "none.pfdb")]) == 1
    out, err = capfd.readouterr()
    assert out == ""
    assert err.count("\n") == 1
    assert "none.pfdb" in err
    assert run(["database", "make"]) == 2
