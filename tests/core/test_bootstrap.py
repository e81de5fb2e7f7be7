"""The way into helper processes."""

import subprocess
import sys
from pathlib import Path

import perfanim
import pytest
from perfanim.core import bootstrap

ASKED = """
import signal, sys
import perfanim

def asked(*words):
    ignored = signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    print(perfanim.__file__, ignored, *map(ascii, words), sys.stdin.readline(), sep="|")
    return 7
"""


@pytest.mark.parametrize("is_blender", [False, True])
def test_a_function_runs_with_the_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_blender: bool) -> None:
    (tmp_path / "for_bootstrap.py").write_text(ASKED)
    monkeypatch.syspath_prepend(tmp_path)
    command, order = bootstrap.command(sys.executable), bootstrap.order("for_bootstrap:asked", "naïve", 3)
    if is_blender:  # its own arguments come first, and Ctrl-C is its affair
        command, lines = [*command, "--background", "--", order], "more"
    else:
        lines = f"{order}\nmore"
    done = subprocess.run(command, input=lines, capture_output=True, text=True, check=False)
    assert done.returncode == 7, done.stderr
    place, ignored, *told = done.stdout.strip().split("|")
    assert Path(place).samefile(str(perfanim.__file__))
    assert ignored == str(not is_blender)
    assert told == [ascii("naïve"), "3", "more"]
