"""The way into helper processes."""

import ast
import json
import re
import signal
import subprocess
import sys
from functools import partial
from pathlib import Path

import perfanim
import pytest
from perfanim.core.system import helper_process

ROOT = Path(perfanim.__file__).parent
ASKED = """
import signal, sys
import perfanim

def asked(*words):
    ignored = signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    print(perfanim.__file__, ignored, *map(ascii, words), sys.stdin.readline(), sep="|")
    return 7
"""


def entry_points() -> list[tuple[Path, str]]:
    """Return where a function is named by a string, "perfanim.module:function", and the string."""
    found = []
    for path in sorted([*(ROOT / "core").rglob("*.py"), *(ROOT / "perfanim_addon").rglob("*.py")]):
        found += [(path, text) for text in re.findall(r'"(perfanim[\w.]*:\w+)"', path.read_text())]
    return found


@pytest.mark.parametrize(("path", "text"), entry_points())
def test_a_function_that_a_string_names_is_there(path: Path, text: str) -> None:
    module, _, name = text.partition(":")
    file = ROOT.joinpath(*module.split(".")[1:]).with_suffix(".py")
    functions = [node.name for node in ast.parse(file.read_text()).body if isinstance(node, ast.FunctionDef)]
    assert name in functions, path


def test_a_function_is_told_by_its_own_module() -> None:
    from perfanim.core.worker import process

    told = json.loads(helper_process.run_request(process.main, 1, "token", "capture"))
    assert told["run"] == f"{process.__name__}:main"
    assert (Path(told["root"]) / "blender_manifest.toml").is_file()


@pytest.mark.parametrize("is_blender", [False, True])
def test_a_function_runs_with_the_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_blender: bool) -> None:
    (tmp_path / "for_bootstrap.py").write_text(ASKED)
    monkeypatch.syspath_prepend(tmp_path)
    command = helper_process.command(sys.executable)
    request = helper_process.run_request("for_bootstrap:asked", "naïve", 3)
    if is_blender:  # its own arguments come first, and Ctrl-C is its affair
        command, lines = [*command, "--background", "--", request], "more"
    else:
        lines = f"{request}\nmore"
    # the tests themselves may have been started in the background, where Ctrl-C is ignored
    heeded = None if sys.platform == "win32" else partial(signal.signal, signal.SIGINT, signal.default_int_handler)
    done = subprocess.run(command, input=lines, capture_output=True, text=True, check=False, preexec_fn=heeded)
    assert done.returncode == 7, done.stderr
    place, ignored, *told = done.stdout.strip().split("|")
    assert Path(place).samefile(str(perfanim.__file__))
    assert ignored == str(not is_blender)
    assert told == [ascii("naïve"), "3", "more"]
