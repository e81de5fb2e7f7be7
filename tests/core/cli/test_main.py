"""Exit status, what goes to stdout and stderr, and that failed work leaves nothing behind."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from perfanim.core import __version__
from perfanim.core.api import solving
from perfanim.core.cli.command_summary import jsonable, summary_text
from perfanim.core.cli.main import COMMANDS, build_parser, main
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.markers.marker_take import save_take
from perfanim.core.markers.subject import save_subject
from perfanim.core.simulate.simulated_markers import simulate_markers


@pytest.fixture(scope="module")
def inputs(tmp_path_factory, truth, subject, database_file):
    """A take, its subject and the database, and broken ones of each."""
    folder = tmp_path_factory.mktemp("inputs")
    take = simulate_markers(truth, subject, noise_mm=1.0)[0]
    save_take(take, folder / "good.take.npz")
    save_subject(subject, folder / "subject.toml")
    whole = database_file.read_bytes()
    (folder / "good.db").write_bytes(whole)
    (folder / "cut.db").write_bytes(whole[: len(whole) // 2])
    return folder


def solve_line(folder, out, database="good.db"):
    return ["solve", str(folder / "good.take.npz"), "--database", str(folder / database),
            "--subject", str(folder / "subject.toml"), "--out", str(out)]  # fmt: skip


def test_solving_prints_only_json_and_exits_with_0(inputs, tmp_path, capsys):
    out = tmp_path / "walk.bvh"
    assert main([*solve_line(inputs, out), "--json"]) == 0
    printed = capsys.readouterr()
    summary = json.loads(printed.out)
    assert printed.err == ""
    assert summary["frames"] == 60
    assert summary["out"] == str(out)
    assert summary["marker_rms_mm"] < 10.0
    assert len(summary["expected_joint_errors_deg"]) == 28
    assert all(0.0 <= error < 90.0 for error in summary["expected_joint_errors_deg"].values())
    assert [path.name for path in tmp_path.iterdir()] == ["walk.bvh"]
    assert read_motion(out).frames == 60


def test_summary_for_a_person(inputs, capsys):
    assert main(["database", "info", str(inputs / "good.db")]) == 0
    printed = capsys.readouterr().out
    assert "frames: 3" in printed
    assert "joints: root, lfemur, ltibia, " in printed
    assert not printed.startswith("{")


def test_a_database_that_is_cut_off_while_it_is_used_gives_no_motion(inputs, tmp_path, capsys, monkeypatch):
    (tmp_path / "some.db").write_bytes((inputs / "good.db").read_bytes())
    solve_take = solving.solve_take

    def solve_and_cut(*args):
        solved = solve_take(*args)
        os.truncate(tmp_path / "some.db", (tmp_path / "some.db").stat().st_size - 10)
        return solved

    monkeypatch.setattr(solving, "solve_take", solve_and_cut)
    assert main(solve_line(inputs, tmp_path / "walk.bvh", database=tmp_path / "some.db")) == 1
    assert "is cut off" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["some.db"]


@pytest.mark.parametrize(
    "line",
    [
        [],
        ["dance"],
        ["solve"],
        ["database"],
        ["solve", "a.csv", "--database", "b", "--subject", "c", "--out", "d", "--method", "magic"],
        ["solve", "a.csv", "--database", "b", "--subject", "c", "--skeleton", "e", "--out", "d"],
        ["database", "build", "a", "--out", "b", "--fps", "many"],
        ["--json"],
    ],
)
def test_wrong_usage_exits_with_2(capsys, line):
    with pytest.raises(SystemExit) as caught:
        main(line)
    assert caught.value.code == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.count("\n") == 1 and "usage: perfanim" in printed.err


@pytest.mark.parametrize(
    "line",
    [
        ["x" * 20_000],
        ["database", "get", "a", *["\x1b[31m\n\udcff"] * 5000],
        ["database", "y" * 20_000],
        ["solve", "a.csv", "--database", "b", "--subject", "c", "--out", "d", "--method", "z" * 20_000],
        ["database", "build", "a", "--out", "b", "--fps", "9" * 20_000 + "x"],
    ],
)
def test_messages_of_wrong_usage_are_short_and_of_one_line(capsys, line):
    with pytest.raises(SystemExit) as caught:
        main(line)
    assert caught.value.code == 2
    (message,) = capsys.readouterr().err.splitlines()
    assert message.startswith("perfanim") and ": error: " in message and " --help)" in message
    assert len(message) <= 300
    assert "\x1b" not in message


def test_version_and_help_exit_with_0(capsys):
    for line in (["--version"], ["--help"], ["solve", "--help"]):
        with pytest.raises(SystemExit) as caught:
            main(line)
        assert caught.value.code == 0
    printed = capsys.readouterr().out
    assert f"perfanim {__version__}" in printed
    assert "--json" in printed


def test_a_parser_of_some_commands_only(capsys):
    assert "solve" in COMMANDS
    with pytest.raises(SystemExit):
        build_parser(("solve",)).parse_args(["database", "info", "x"])
    assert "invalid choice: 'database'" in capsys.readouterr().err


def test_an_interrupt_exits_with_130(monkeypatch, inputs, tmp_path, capsys):
    def interrupted(*args, **settings):
        raise KeyboardInterrupt

    monkeypatch.setattr("perfanim.core.api.solving.solve_take", interrupted)
    assert main(solve_line(inputs, tmp_path / "walk.bvh")) == 130
    assert capsys.readouterr().err == "perfanim: interrupted\n"
    assert not any(tmp_path.iterdir())


def test_the_command_as_a_process(inputs, tmp_path):
    command = [sys.executable, "-m", "perfanim.core.cli.main"]
    environment = os.environ | {"PYTHONWARNINGS": "error::RuntimeWarning"}
    good = subprocess.run(
        [*command, "database", "info", str(inputs / "good.db"), "--json"],
        capture_output=True, text=True, env=environment, check=False,
    )  # fmt: skip
    assert (good.returncode, good.stderr) == (0, "")
    assert json.loads(good.stdout)["fps"] == 30.0
    bad = subprocess.run(
        [*command, *solve_line(inputs, tmp_path / "a.bvh", database="cut.db")],
        capture_output=True, text=True, env=environment, check=False,
    )  # fmt: skip
    assert (bad.returncode, bad.stdout) == (1, "")
    assert bad.stderr.startswith("perfanim: ") and bad.stderr.count("\n") == 1


@pytest.mark.skipif(sys.platform == "win32", reason="there are no such pipes")
@pytest.mark.parametrize("line", ["database info {} --json", "database info {}", "--version", "database info gone.db"])
def test_an_output_that_nobody_reads_ends_the_command_quietly(inputs, line):
    command = [sys.executable, "-m", "perfanim.core.cli.main", *line.format(inputs / "good.db").split()]
    reading, writing = os.pipe()
    os.close(reading)
    pipes = (subprocess.PIPE, writing) if line.endswith("gone.db") else (writing, subprocess.PIPE)
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONUNBUFFERED"}  # written at the end
    done = subprocess.run(command, stdout=pipes[0], stderr=pipes[1], env=environment, check=False)
    os.close(writing)
    assert (done.returncode, done.stdout or b"", done.stderr or b"") == (141, b"", b"")


@pytest.mark.skipif(sys.platform == "win32", reason="there is no such shell")
@pytest.mark.parametrize(("closed", "status"), [("database info {} >&-", 0), ("database info gone.db 2>&-", 1)])
def test_closed_outputs_are_like_none(inputs, closed, status):
    line = f"exec {sys.executable} -m perfanim.core.cli.main {closed.format(inputs / 'good.db')}"
    done = subprocess.run(["/bin/sh", "-c", line], capture_output=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (status, b"", b"")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no full device")
def test_an_output_on_a_full_disk_is_one_line(inputs):
    with Path("/dev/full").open("wb") as full:
        command = [sys.executable, "-m", "perfanim.core.cli.main", "database", "info", str(inputs / "good.db")]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert (done.returncode, done.stderr.count("\n")) == (1, 1)
    assert done.stderr.startswith("perfanim: the output cannot be written (No space left")


def test_figures_without_a_value_are_null_in_json():
    value = jsonable({"a": np.float64("nan"), "b": np.array([1.0, np.inf]), "c": (np.int64(3), Path("/x")), 4: None})
    assert json.loads(json.dumps(value, allow_nan=False)) == {
        "a": None,
        "b": [1.0, None],
        "c": [3, str(Path("/x"))],
        "4": None,
    }


def test_summary_text():
    text = summary_text(
        {"rms_mm": 1.23456, "names": ["a", "b"], "many": list(range(20)), "parts": {"x": 0.5}, "out": "f"}
    )
    assert text.splitlines() == ["rms mm: 1.235", "names: a, b", "many: 20", "parts: x 0.5", "out: f"]
    (line,) = summary_text({"names": [f"M{n:02}" for n in range(70)]}).splitlines()
    assert line.startswith("names: M00, M01") and line.endswith("M59, and 10 more, see --json")


def test_a_long_table_of_figures_does_not_bury_the_others():
    (line,) = summary_text({"bones_mm": {f"b{n}": 1.5 for n in range(29)}}).splitlines()
    assert line.startswith("bones mm: b0 1.5, b1 1.5") and line.endswith("b11 1.5, and 17 more, see --json")


def test_rows_of_a_report_get_a_line_each():
    rows = [{"file": "a.bvh", "line": 3, "reason": "cut off"}, {"file": "b.bvh", "line": None, "reason": "empty"}]
    assert summary_text({"skipped": rows}).splitlines() == ["skipped: 2", "  a.bvh, 3, cut off", "  b.bvh, empty"]
    table = {"root": {"deg": 1.23456, "twist_deg": None}, "head": {"deg": 2.0, "twist_deg": 0.5}}
    assert summary_text({"per_joint": table}).splitlines() == [
        "per joint:",
        "  root: deg=1.235",
        "  head: deg=2 twist_deg=0.5",
    ]
    stretches = [{"start_s": 0.0, "stop_s": 1.5, "reason": ""}]  # from the very beginning
    assert summary_text({"doubtful": stretches}).splitlines() == ["doubtful: 1", "  start s 0, stop s 1.5"]
    assert summary_text({"doubtful": {}, "warnings": []}).splitlines() == ["doubtful: none", "warnings: none"]
    assert summary_text({"worst": [{"frame": 220, "error_mm": 51.42527}]}).splitlines()[1] == "  220, error mm 51.43"
    take = {"name": "walk", "warnings": ["uneven", "short"], "parts": {"torso": 0.87875760, "head": 1.0}}
    assert summary_text({"takes": [take]}).splitlines()[1] == "  walk, uneven; short, parts torso=0.8788 head=1"
    lines = summary_text({"skipped": rows * 100}).splitlines()
    assert (lines[0], lines[-1], len(lines)) == ("skipped: 200", "  and 140 more, see --json", 62)
