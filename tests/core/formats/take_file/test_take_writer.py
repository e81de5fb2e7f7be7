"""Writing of a take: locked meanwhile, continued after a kill, kept in memory while the disk is full."""

import errno
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from perfanim.core.errors import TakeError
from perfanim.core.formats.take_file import take_writer as writer_module
from perfanim.core.formats.take_file.append_notes import append_notes
from perfanim.core.formats.take_file.chunks import HEADER_BYTES, ChunkKind, scan
from perfanim.core.formats.take_file.take_reader import read_take_file, summarise
from perfanim.core.formats.take_file.take_recovery import recover
from perfanim.core.formats.take_file.take_setup import TakeNotes, TakeSetup
from perfanim.core.formats.take_file.take_writer import TakeWriter, WriterSettings
from perfanim.core.system.lock import is_locked
from records import frame_record, frames_of, pose_record, poses_of

Write = Callable[..., Path]


def test_a_take_whose_writer_was_killed_is_gone_on_with(
    tmp_path: Path, write: Write, setup: TakeSetup, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(writer_module, "SETTINGS", WriterSettings(write_every_s=3600.0))
    data = write(tmp_path / "whole.perftake").read_bytes()
    frames = [chunk for chunk in scan(data, "")[0] if chunk.kind == ChunkKind.FRAMES]
    path = tmp_path / "cut.perftake"
    path.write_bytes(data[: frames[2].offset + HEADER_BYTES + 5])  # two whole chunks of frames, and a piece
    other = replace(setup, created="later")
    writer = TakeWriter(path, other, resumed=True)
    assert writer.last_frame is not None
    assert writer.last_frame[1].number == 5
    assert is_locked(path)
    writer.add_gap("the solver's process hung: started again, 0.5 s are missing", 5, 0.5)
    writer.add_frame(frame_record(40))
    writer.add_pose(pose_record(40))
    writer.close()
    take = read_take_file(path)
    assert take.complete
    assert frames_of(take) == [frame_record(number) for number in (0, 1, 2, 3, 4, 5, 40)]
    assert poses_of(take) == [pose_record(number) for number in (0, 1, 2, 3, 4, 5, 40)]
    assert take.setup == setup
    assert take.notes.name == "Walk 1"
    assert [(gap.after, gap.seconds) for gap in take.gaps] == [(5, 0.5)]
    assert take.events == ("the solver's process hung: started again, 0.5 s are missing",)
    assert summarise(path).duration_s == pytest.approx(40 / 60)
    with pytest.raises(TakeError, match="has ended"):  # a whole one is not
        TakeWriter(path, setup, resumed=True)
    assert read_take_file(path).complete
    assert not is_locked(path)


def test_a_take_being_written_is_locked_and_can_be_read(
    tmp_path: Path, setup: TakeSetup, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(writer_module, "SETTINGS", WriterSettings(write_every_s=3600.0))  # the test plays the thread
    path = tmp_path / "a.perftake"
    writer = TakeWriter(path, setup)
    try:
        writer.add_frame(frame_record(0))
        writer._collect()
        writer._write()
        assert is_locked(path)
        take = read_take_file(path)
        assert frames_of(take) == [frame_record(0)]
        with pytest.raises(TakeError, match="is being recorded"):
            recover(take, tmp_path / "b.perftake")
        with pytest.raises(TakeError, match="is being recorded"):
            append_notes(path, TakeNotes())
        with pytest.raises(TakeError, match="cannot be recorded"):
            TakeWriter(path, setup)
    finally:
        writer.close()
    assert not is_locked(path)
    assert not list(tmp_path.glob("b*"))


def test_a_full_disk_is_told_and_nothing_is_lost_when_there_is_space_again(
    tmp_path: Path, setup: TakeSetup, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[str] = []
    space = [10**9]

    def limited(handle: int, data: memoryview) -> int:
        """Write what there is space for, as a full disk does: first a part, then nothing."""
        if not space[0]:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        part = data[: space[0]]
        space[0] -= len(part)
        return os.pwrite(handle, part, os.lseek(handle, 0, os.SEEK_CUR)) + 0 * os.lseek(handle, len(part), os.SEEK_CUR)

    monkeypatch.setattr(writer_module, "SETTINGS", WriterSettings(write_every_s=3600.0))  # the test plays the thread
    writer = TakeWriter(tmp_path / "a.perftake", setup, report=told.append)
    monkeypatch.setattr(writer_module.os, "write", limited)
    for number in range(8):
        space[0] = 500 if number < 4 else 10**9
        writer.add_frame(frame_record(number))
        writer._collect()
        writer._write()
        take = read_take_file(tmp_path / "a.perftake")
        assert not take.faults  # what did not fit is taken back
        assert len(take.frames) == (0 if number < 4 else number + 1)
    writer.close()
    monkeypatch.undo()
    assert [text[:31] for text in told] == ["the take is not being written (", ""]
    take = read_take_file(tmp_path / "a.perftake")
    assert take.complete
    assert frames_of(take) == [frame_record(number) for number in range(8)]


def test_a_take_whose_disk_stays_full_is_whole_in_another_folder(
    tmp_path: Path, setup: TakeSetup, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = tmp_path / "home"
    home.mkdir()
    monkeypatch.setattr(Path, "home", lambda: home)
    monkeypatch.setattr(writer_module, "SETTINGS", WriterSettings(write_every_s=3600.0))
    told: list[str] = []
    writer = TakeWriter(tmp_path / "a.perftake", setup, report=told.append)
    for number in range(3):
        writer.add_frame(frame_record(number))
    writer._collect()
    writer._write()

    def full(handle: int, data: memoryview) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(writer_module.os, "write", full)
    for number in range(3, 8):
        writer.add_frame(frame_record(number))
    writer.close()
    monkeypatch.undo()
    assert writer.path == home / "a.perftake"
    assert str(writer.path) in told[-1]
    take = read_take_file(writer.path)
    assert take.complete
    assert frames_of(take) == [frame_record(number) for number in range(8)]
    begun = read_take_file(tmp_path / "a.perftake")
    assert frames_of(begun) == [frame_record(number) for number in range(3)]  # what fitted stays where it is


def test_a_disk_that_stays_full_costs_no_more_memory_than_allowed(
    tmp_path: Path, setup: TakeSetup, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(writer_module, "SETTINGS", WriterSettings(write_every_s=3600.0, most_waiting=5000))
    writer = TakeWriter(tmp_path / "a.perftake", setup)
    full = [True]
    write = os.write

    def nothing(handle: int, data: memoryview) -> int:
        if full[0]:
            raise OSError(errno.EDQUOT, os.strerror(errno.EDQUOT))
        return write(handle, data)

    monkeypatch.setattr(writer_module.os, "write", nothing)
    for number in range(40):
        full[0] = number < 30
        writer.add_frame(frame_record(number))
        writer._collect()
        writer._write()
        assert len(writer._waiting) < 5000 + 2 * len(frame_record(0))
    writer.close()
    take = read_take_file(tmp_path / "a.perftake")
    assert take.complete
    numbers = [frame.number for frame in take.frames]
    lost = set(range(40)) - set(numbers)
    assert numbers == sorted(numbers)
    assert take.events == (f"{len(lost)} frames could not be kept: the disk was full",)
    assert 20 < len(lost) < 32
