"""Records that others may have written: nothing outside the results is read, shown, or removed."""

import hashlib
import json
import os
import sys
import threading
from dataclasses import replace

import pytest
from perfanim.core.cli.batch.html_report import page_text
from perfanim.core.cli.batch.plan import TakePlan
from perfanim.core.cli.batch.run_batch import run_batch
from perfanim.core.cli.batch.take_record import (
    BAD,
    GOOD,
    Record,
    Task,
    failed_record,
    finished_record,
    record_path,
    remove_old,
    stored_record,
)
from perfanim.core.errors import FormatError

PATIENCE_S = 60.0
SECRET = b"a secret"
SHA256 = hashlib.sha256(SECRET).hexdigest()
TAKE = TakePlan("walk", "walk.c3d", "walk.c3d", digest="new")
RECORD = Record("walk", "walk.c3d", "new", GOOD, figures={"frames": 3, "confidence": None})
NO_FIFO = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="the system has no named pipes")


@pytest.fixture
def out(tmp_path):
    folder = tmp_path / "out"
    (folder / "report").mkdir(parents=True)
    (tmp_path / "victim").mkdir()
    return folder


def store(out, record):
    record_path(out, "walk").write_text(record.text())


def returned(function, *arguments):
    """Return what a function returns that may wait for ever."""
    found = []
    thread = threading.Thread(target=lambda: found.append(function(*arguments)), daemon=True)
    thread.start()
    thread.join(PATIENCE_S)
    return found[0]


def test_a_record_is_read_as_it_was_written(out):
    (out / "walk.bvh").write_bytes(SECRET)
    record = replace(RECORD, outputs={"motion": "walk.bvh"}, sha256={"walk.bvh": SHA256}, reasons=("caf\udce9",))
    store(out, record)
    assert finished_record(TAKE, out) == record
    store(out, replace(record, is_kept=False))
    assert finished_record(TAKE, out) is None
    remove_old(TAKE, out)
    assert not (out / "walk.bvh").exists()
    assert not record_path(out, "walk").exists()


@pytest.mark.parametrize("kind", ["motion", "picture"])
@pytest.mark.parametrize(
    "file",
    ["../victim/walk_precious.txt", "../victim/walk.bvh", "{}/victim/walk.bvh", "walk_2.bvh", "report/../walk.bvh"],
)
def test_files_that_are_not_the_takes_own_are_left_alone(out, tmp_path, kind, file):
    file = file.format(tmp_path)
    (out / file).write_bytes(SECRET)
    store(out, replace(RECORD, outputs={kind: file}, sha256={file: SHA256}))
    assert finished_record(TAKE, out) is None
    store(out, replace(RECORD, digest="old", outputs={kind: file}))
    remove_old(TAKE, out)
    assert (out / file).read_bytes() == SECRET
    assert not record_path(out, "walk").exists()


def test_a_link_out_of_the_results_is_none_of_them(out, tmp_path):
    (tmp_path / "victim" / "secret").write_bytes(SECRET)
    (out / "report" / "walk.jpg").symlink_to(tmp_path / "victim" / "secret")
    store(out, replace(RECORD, outputs={"picture": "report/walk.jpg"}, sha256={"report/walk.jpg": SHA256}))
    assert finished_record(TAKE, out) is None


def test_results_without_a_digest_are_none(out):
    (out / "walk.bvh").write_bytes(SECRET)
    store(out, replace(RECORD, outputs={"motion": "walk.bvh"}))
    assert finished_record(TAKE, out) is None
    (out / "walk.bvh").unlink()
    store(out, replace(RECORD, outputs={"motion": "walk.bvh"}, sha256={"walk.bvh": ""}))  # as that of no file
    assert finished_record(TAKE, out) is None


@pytest.mark.parametrize(
    "change",
    [
        {"figures": []}, {"figures": {"frames": "3"}}, {"outputs": {"motion": 3}}, {"outputs": []}, {"sha256": None},
        {"status": "fine"}, {"reasons": "abc"}, {"warnings": [[]]}, {"name": "run"}, {"name": 3}, {"is_kept": 1},
        {"more": 1},
    ],
)  # fmt: skip
def test_records_of_another_form_are_none(out, change):
    record_path(out, "walk").write_text(json.dumps(json.loads(RECORD.text()) | change))
    assert stored_record("walk", out) is None


@pytest.mark.parametrize("text", ["[" * 100_000, '{"figures": ' * 50_000, "[]", "3", '"abc"', "null", "", "\udcff"])
def test_texts_that_are_no_record(out, text):
    record_path(out, "walk").write_bytes(text.encode("utf-8", "surrogateescape"))
    assert stored_record("walk", out) is None
    with pytest.raises(FormatError):
        Record.of_text(text)


def test_a_record_has_a_largest_size(out):
    store(out, replace(RECORD, warnings=("a" * (1 << 20),)))
    assert stored_record("walk", out) is None


@NO_FIFO
def test_a_pipe_is_no_record_and_no_picture(out):
    os.mkfifo(out / "report" / "walk.json")
    os.mkfifo(out / "report" / "walk.jpg")
    assert returned(stored_record, "walk", out) is None
    record = Record.of_text(replace(RECORD, outputs={"picture": "report/walk.jpg"}).text())
    assert "walk" in returned(page_text, [record], out)


def test_a_picture_that_is_gone_or_too_large_is_not_shown(out):
    record = replace(RECORD, outputs={"picture": "report/walk.jpg"})
    assert "data:image" not in page_text([record], out)
    (out / "report" / "walk.jpg").write_bytes(bytes((4 << 20) + 1))
    assert "data:image" not in page_text([record], out)
    (out / "report" / "walk.jpg").write_bytes(SECRET)
    assert "data:image" in page_text([record], out)


@pytest.mark.skipif(sys.platform == "win32", reason="another limit, of whole paths")
@pytest.mark.parametrize("length", [240, 300])
def test_a_take_with_too_long_a_name_fails_alone(out, tmp_path, length):
    takes = [replace(TAKE, name=name, take=str(tmp_path / "walk.c3d")) for name in ("a" * length, "walk")]
    asked: list[str] = []

    def do(tasks: list[Task]):
        asked.extend(task.take.name for task in tasks)
        yield from (failed_record(task.take, "is not done here") for task in tasks)

    result = run_batch(takes, out, do, lambda fraction, text: None)
    assert asked == ["walk"]
    record = result.records[0]
    assert (record.name, record.status, record.is_kept, result.finished_before) == ("a" * length, BAD, False, set())
    assert record.reasons[0].startswith("cannot be written (")
    assert record.reasons[0].endswith('; give the take a shorter name (name = "...")')
    assert "is not done here" in (out / "summary.csv").read_text()


def test_old_results_that_cannot_be_removed_fail_their_take_alone(out, tmp_path):
    record_path(out, "walk").mkdir()
    takes = [replace(TAKE, name=name, take=str(tmp_path / "walk.c3d")) for name in ("run", "walk")]

    def do(tasks: list[Task]):
        yield from (failed_record(task.take, "is not done here") for task in tasks)

    run, walk = run_batch(takes, out, do, lambda fraction, text: None).records
    assert run.reasons == ("is not done here",)
    assert "choose a folder" in walk.reasons[0]
