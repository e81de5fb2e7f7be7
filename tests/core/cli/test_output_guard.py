"""No command writes onto its own input, nor beside another one that writes the same file."""

import argparse
import shlex
from pathlib import Path

import pytest
from perfanim.core.cli.main import main
from perfanim.core.cli.output_guard import guarded_run
from perfanim.core.errors import FormatError
from perfanim.core.system.files import atomic_path
from perfanim.core.system.progress import no_progress

LINES = (
    "take export a.c3d --out a.c3d",
    "take export a.c3d --out link.c3d",
    "take fill a.c3d --database db.pfdb --out a.c3d",
    "take recover a.perftake --out a.perftake",
    "solve a.bvh --database db.pfdb --out a.bvh",
    "solve a.perftake --out a.perftake",
    "track --cameras rig.toml --left a.c3d --right a.mp4 --out a.c3d",
    "simulate markers a.csv --marker-set boxing --out a.csv",
    "database build other.bvh a.bvh --out a.bvh",
    "calibrate cameras --camera a=a.toml --camera b=b.mp4 --board chessboard:9x6:24mm --out a.toml",
    "calibrate refine --cameras rig.toml --left a.mp4 --right a.mp4 --out rig.toml",
    "calibrate floor --cameras rig.toml --left a.mp4 --right a.mp4 --out rig.toml",
    "calibrate subject a.toml --marker-set boxing --poses t --out a.toml",
    "calibrate prop a.toml --out a.toml",
    "retarget a.bvh --to hero.glb --out hero.glb",
    "sketch a.bvh --database db.pfdb --out a.bvh",
)


@pytest.mark.parametrize("line", LINES)
def test_a_command_does_not_write_onto_its_input(
    line: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    names = ("a.c3d", "a.perftake", "a.bvh", "a.csv", "a.toml", "a.mp4", "rig.toml", "hero.glb", "db.pfdb", "other.bvh")
    for name in names:
        (tmp_path / name).write_text("an input")
    (tmp_path / "link.c3d").symlink_to("a.c3d")
    assert main(shlex.split(line)) == 1
    told = capsys.readouterr().err
    assert told.count("\n") == 1 and "is an input and would be overwritten; give the output another name" in told
    assert {(tmp_path / name).read_text() for name in names} == {"an input"}
    assert len(list(tmp_path.iterdir())) == len(names) + 1


def test_an_output_is_locked_while_a_command_computes(tmp_path: Path) -> None:
    out = tmp_path / "a.pfdb"

    def run(args: argparse.Namespace, progress: object) -> str:
        with pytest.raises(FormatError, match=r"a\.pfdb: is being written by another program"):
            guarded_run(argparse.Namespace(run=lambda *_: "second", out=str(out)), no_progress)
        with atomic_path(args.out) as temporary:
            temporary.write_text("first")
        return "first"

    assert guarded_run(argparse.Namespace(run=run, out=str(out), sources=[str(tmp_path)]), no_progress) == "first"
    assert out.read_text() == "first"
    assert guarded_run(argparse.Namespace(run=lambda *_: "third", out=str(out)), no_progress) == "third"
    assert [path.name for path in tmp_path.iterdir()] == ["a.pfdb"]
