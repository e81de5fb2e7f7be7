"""What a folder of takes becomes, and that it becomes the same again however it is come by."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace

import pytest
from perfanim.core.cli.batch.plan import plan_of
from perfanim.core.cli.batch.run_batch import run_batch
from perfanim.core.cli.batch.take_record import BAD, DOUBTFUL, GOOD, failed_record
from perfanim.core.cli.main import main
from perfanim.core.errors import FormatError, SettingsError
from perfanim.core.formats.markers.marker_files import read_take
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.session.solve_take import solve_take
from perfanim.core.solver.settings import SolveSettings
from perfanim.core.system.lock import lock
from perfanim.tests.core.cli.batch.conftest import FRAMES, do_here, files, in_others, run
from soak.processes import is_running

PATIENCE_S = 20.0
REASONS = {
    "blank": "no frame shows the markers of the torso",
    "broken": "broken.trc, line 3: has no header values",
    "empty": "is empty",
    "exchanged": "no body fits the markers",
    "foreign": "choose the marker set that was worn",
}


def test_good_takes_are_done_and_bad_ones_named_with_the_reason(finished):
    out, result = finished
    status = {record.name: record.status for record in result.records}
    assert [name for name, word in status.items() if word == BAD] == sorted(REASONS)
    assert set(status) - set(REASONS) == {"a", "b", "c", "d"}
    for record in result.records:
        if record.name in REASONS:
            assert REASONS[record.name] in record.reasons[0]
            assert not (out / f"{record.name}.bvh").exists()
            assert str(out) not in record.reasons[0]
        else:
            motion = read_motion(out / record.outputs["motion"])
            assert motion.frames == record.figures["frames"] == FRAMES
            assert record.figures["marker_rms_mm"] < 10.0
            assert (out / record.outputs["picture"]).read_bytes().startswith(b"\xff\xd8")
    assert not list(out.glob(".unfinished*"))


def test_a_second_run_does_nothing_again(finished, inputs):
    out, first = finished
    before, times = files(out), {p: p.stat().st_mtime_ns for p in out.glob("*.bvh")}

    def nobody(tasks):
        raise AssertionError(f"{len(tasks)} takes are done again")

    again = run(inputs.plan(), out, nobody)
    assert again.records == first.records
    assert again.finished_before == {record.name for record in first.records}
    assert files(out) == before
    assert {p: p.stat().st_mtime_ns for p in out.glob("*.bvh")} == times


def test_only_what_has_changed_is_done_again(finished, inputs, tmp_path):
    out, takes, took = tmp_path / "out", tmp_path / "takes", []
    shutil.copytree(finished[0], out)
    shutil.copytree(inputs.takes, takes)
    elsewhere = replace(inputs, takes=takes)

    def noted(tasks):
        took.extend(task.take.name for task in tasks)
        yield from (failed_record(task.take, "is not done here") for task in tasks)

    run(elsewhere.plan(), out, noted)
    assert took == []
    (out / "a.bvh").write_text("damaged")
    (out / "report" / "b.json").write_text("damaged")
    (out / "report" / "c.jpg").unlink()
    (takes / "d.take.npz").write_bytes(b"no take any more")
    run(elsewhere.plan(), out, noted)
    assert sorted(took) == ["a", "b", "c", "d"]
    assert not (out / "d.bvh").exists()  # of another file
    assert not (out / "report" / "d.json").exists()
    took.clear()
    run(elsewhere.plan("blank.csv", method="nearest"), out, noted)
    assert took == ["blank"]


@pytest.mark.long
@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="a kill is a signal")
def test_killed_in_the_middle_and_started_again(finished, inputs, tmp_path):
    """The batch is killed when two takes are done and its two workers have begun others; what is left is done in
    another order, by one process. No worker is left, and all is as if it had never been interrupted."""
    script, out = tmp_path / "killed.py", tmp_path / "out"
    given = {"database": str(inputs.database), "subject": str(inputs.subject)}
    script.write_text(f"""
import os, signal
from pathlib import Path
from perfanim.core.cli.batch.plan import plan_of
from perfanim.core.cli.batch.processes import in_processes
from perfanim.core.cli.batch.plan import plan_of
from perfanim.core.cli.batch.run_batch import run_batch
from perfanim.core.cli.batch import take_server

def dying(tasks):
    for number, record in enumerate(in_processes(take_server.serve, 2, tasks)):
        if number == 2:
            started = Path(f"/proc/self/task/{{os.getpid()}}/children")
            print(started.read_text() if started.exists() else "", flush=True)
            os.kill(os.getpid(), signal.SIGKILL)
        yield record

plan = plan_of([{str(inputs.takes)!r}], {given!r})
run_batch(plan.takes, Path({str(out)!r}), dying, lambda fraction, text: None)
""")
    killed = subprocess.run([sys.executable, str(script)], stdout=subprocess.PIPE, text=True, check=False)
    assert killed.returncode == -signal.SIGKILL
    limit_s = time.monotonic() + PATIENCE_S
    while any(is_running(int(worker)) for worker in killed.stdout.split()):
        assert time.monotonic() < limit_s, "a worker is left"
        time.sleep(0.05)
    assert not (out / "summary.html").exists()
    result = run(inputs.plan()[::-1], out, lambda tasks: in_others(1, tasks[::-1]))
    assert 2 <= len(result.finished_before) < len(result.records)
    assert files(out) == files(finished[0])


def test_doubtful_takes_say_why(inputs, tmp_path):
    whole = (inputs.takes / "a.c3d").read_bytes()
    (tmp_path / "cut.c3d").write_bytes(whole[: len(whole) - 600])
    result = run(replace(inputs, takes=tmp_path).plan("cut.c3d"), tmp_path / "out")
    record = result.records[0]
    assert record.status == DOUBTFUL
    assert f"of {FRAMES} frames" in record.reasons[0]
    assert (tmp_path / "out" / "cut.bvh").exists()


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere names of files are text")
def test_names_that_are_no_text_are_taken_like_others(inputs, tmp_path, capsys):
    takes, name = tmp_path / "takes", os.fsdecode(b"caf\xe9")
    takes.mkdir()
    shutil.copy(inputs.takes / "a.c3d", takes / f"{name}.c3d")
    (takes / f"{name}-broken.trc").write_text("PathFileType\t4\nno more than that\n")
    line = ["--database", str(inputs.database), "--subject", str(inputs.subject), "--out", str(tmp_path / "out")]
    assert main(["batch", str(takes), *line, "--jobs", "1", "--json"]) == 1  # as one is broken
    said = capsys.readouterr()
    assert "Traceback" not in said.err
    told = json.loads(said.out)
    assert (told["good"] + told["doubtful"], told["bad"]) == (1, 1)
    assert (tmp_path / "out" / f"{name}.bvh").exists()
    assert 'href="caf%E9.bvh"' in (tmp_path / "out" / "summary.html").read_text()
    assert "caf\\udce9," in (tmp_path / "out" / "summary.csv").read_text()


def test_a_batch_removes_what_killed_commands_left_in_its_folder(inputs, tmp_path):
    (tmp_path / ".a.a1b2c3d4.bvh").write_text("half")
    os.utime(tmp_path / ".a.a1b2c3d4.bvh", (0.0, 0.0))
    run(inputs.plan("empty.c3d"), tmp_path)
    assert not list(tmp_path.glob(".*"))


def test_what_cannot_be_written_is_tried_again(inputs, tmp_path):
    out = tmp_path / "out"
    (out / "a.bvh").mkdir(parents=True)
    record = run(inputs.plan("a.c3d"), out).records[0]
    assert (record.status, record.is_kept) == (BAD, False)
    assert "cannot be written" in record.reasons[0]
    (out / "a.bvh").rmdir()
    result = run(inputs.plan("a.c3d"), out)
    assert (result.records[0].status, len(result.finished_before)) == (GOOD, 0)


def test_one_batch_at_a_time_writes_into_a_folder(inputs, tmp_path):
    (tmp_path / "report").mkdir()
    handle = os.open(tmp_path / "report" / ".lock", os.O_RDWR | os.O_CREAT)
    try:
        assert lock(handle)
        with pytest.raises(SettingsError, match="another batch"):
            run(inputs.plan("a.c3d"), tmp_path)
    finally:
        os.close(handle)
    (tmp_path / "file").write_text("")
    with pytest.raises(FormatError, match="cannot be written"):
        run(inputs.plan("a.c3d"), tmp_path / "file" / "out")


def test_the_summary_in_three_forms(finished):
    out, result = finished
    told = json.loads((out / "summary.json").read_text())
    assert (told["good"] + told["doubtful"], told["bad"]) == (4, 5)
    assert [take["name"] for take in told["takes"]] == [record.name for record in result.records]
    rows = (out / "summary.csv").read_text().splitlines()
    assert len(rows) == 10
    assert rows[0].startswith("name,take,status,reasons,")
    page = (out / "summary.html").read_text()
    assert "<h1>9 takes: 5 bad" in page
    assert page.index("exchanged") < page.index(">a</a>")  # bad ones first
    assert page.count("data:image/jpeg;base64,") == 4 + 2  # two bad ones were solved, to nothing
    assert "http" not in page


def test_progress_tells_how_long_it_takes(inputs, tmp_path):
    told = []
    run_batch(inputs.plan("a.c3d", "empty.c3d"), tmp_path, do_here, lambda f, text: told.append((f, text)))
    fractions = [fraction for fraction, text in told if "takes" in text]
    assert fractions == sorted(fractions)
    assert told[-2][1] == "2 of 2 takes, 1 bad, 0 s left"
    alone = []
    plan = inputs.plan("empty.c3d", "a.c3d")
    run_batch(plan, tmp_path / "alone", first_of(do_here), lambda f, text: alone.append(text))
    assert "1 of 2 takes, 1 bad" in alone  # what an empty file took says nothing of the others


def first_of(do_tasks):
    """Do the bad take first, whatever comes first by its size."""
    return lambda tasks: do_tasks(sorted(tasks, key=lambda task: task.take.name, reverse=True))


def test_a_recorded_take_needs_nothing_else(inputs, subject, database, tmp_path):
    """It holds its subject and tells its database and method."""
    markers = read_take(inputs.takes / "a.c3d")
    settings = SolveSettings(method="nearest")
    solve_take(markers, subject, database, settings, lambda fraction, text: None).save(tmp_path / "a.perftake")
    recorded = plan_of([str(tmp_path / "a.perftake")], {}).takes
    record = run(recorded, tmp_path / "out").records[0]
    assert record.status in (GOOD, DOUBTFUL)
    alone = read_motion(tmp_path / "out" / "a.bvh")
    again = run(inputs.plan("a.c3d", method="nearest"), tmp_path / "again").records[0]
    assert record.figures == again.figures
    assert alone.frames == FRAMES
