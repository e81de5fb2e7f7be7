"""A take is what was put in; whatever is cut off or damaged is told, and the rest is read."""

import errno
import json
import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from perfanim.core.errors import PerfanimError, PropError, SubjectError, TakeError
from perfanim.core.formats.take_file import writer as writer_module
from perfanim.core.formats.take_file.chunks import HEADER_BYTES, PREAMBLE_BYTES, ChunkKind, encode_chunk, preamble, scan
from perfanim.core.formats.take_file.edit import append_notes, recover
from perfanim.core.formats.take_file.lock import is_locked
from perfanim.core.formats.take_file.pose_codec import pack_solved
from perfanim.core.formats.take_file.reading import TakeFile, read_take_file, summarise
from perfanim.core.formats.take_file.setup import TakeNotes, TakeSetup
from perfanim.core.formats.take_file.whole import write_whole_take
from perfanim.core.formats.take_file.writer import TakeWriter
from perfanim.core.markers.marker_frame_codec import pack_stamped
from perfanim.core.markers.prop import load_prop, prop_tables
from records import frame_record, pose_record

Write = Callable[..., Path]


def frames_of(take: TakeFile) -> list[bytes]:
    return [pack_stamped(stamp_s, frame) for stamp_s, frame in take.stamped_frames]


def poses_of(take: TakeFile) -> list[bytes]:
    return [pack_solved(solved) for solved in take.poses]


def test_what_is_written_is_read_to_the_last_bit(tmp_path: Path, write: Write, setup: TakeSetup) -> None:
    take = read_take_file(write(tmp_path / "a.perftake"))
    assert take.complete
    assert take.problems == []
    assert frames_of(take) == [frame_record(number) for number in range(12)]
    assert poses_of(take) == [pose_record(number) for number in range(12)]
    assert take.setup == setup
    assert take.notes == TakeNotes("Walk 1")
    rig, subject = take.setup.camera_rig(), take.setup.subjects()[0]
    for camera, wanted in zip(rig.cameras, setup.camera_rig().cameras, strict=True):
        np.testing.assert_array_equal(camera.rotation, wanted.rotation)
        np.testing.assert_array_equal(camera.translation_m, wanted.translation_m)
    np.testing.assert_array_equal(subject.marker_set.offsets_m, setup.subjects()[0].marker_set.offsets_m)
    listed = summarise(tmp_path / "a.perftake")
    assert (listed.complete, listed.frames, listed.created, listed.notes) == (True, 12, setup.created, take.notes)
    assert listed.duration_s == pytest.approx(11 / 60)


def test_takes_of_the_first_version_stay_readable() -> None:
    """The file was written once; whatever changes in marker frames, poses or the layout, old takes are still read."""
    take = read_take_file(Path(__file__).with_name("version-1.perftake"))
    assert take.complete
    assert (take.notes.name, take.notes.rating, take.events) == ("Walk 1", 3, ("left camera frozen",))
    assert take.setup.settings == {"method": "lwr"}
    assert take.setup.subjects()[0].marker_set.names[0] == "HEAD"
    assert take.setup.carried_props() == ()
    assert len(take.setup.camera_rig()) == 2
    assert [frame.number for frame in take.frames] == [solved.pose.number for solved in take.poses] == [0, 1]
    first = take.frames[0]
    assert first.notes == ("left camera frozen",)
    np.testing.assert_allclose(first.detected[1], first.blobs[1] + 0.5, atol=1e-6)
    assert first.points_m.shape == (3, 3)
    np.testing.assert_allclose(np.linalg.norm(take.poses[1].pose.performers[0].rotations, axis=1), 1.0)


def test_a_take_whose_writer_was_killed_is_gone_on_with(
    tmp_path: Path, write: Write, setup: TakeSetup, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(writer_module, "WRITE_EVERY_S", 3600.0)
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


def test_every_cut_leaves_all_whole_chunks(tmp_path: Path, write: Write) -> None:
    data = write(tmp_path / "whole.perftake", 4, 2).read_bytes()
    chunks, _ = scan(data, "")
    stops = [chunk.offset + HEADER_BYTES + len(chunk.payload) for chunk in chunks]
    for size in range(len(data)):
        if size < PREAMBLE_BYTES:
            with pytest.raises(TakeError, match=r"empty|cut off before anything"):
                scan(data[:size], "")
            continue
        found, faults = scan(data[:size], "")
        assert [chunk.offset for chunk in found] == [
            c.offset for c, stop in zip(chunks, stops, strict=True) if stop <= size
        ]
        at_border = size in (PREAMBLE_BYTES, *stops)
        assert [fault.cut for fault in faults] == ([] if at_border else [True])
        assert size == len(data) or not any(chunk.kind == ChunkKind.END for chunk in found)
    # read as takes where a chunk ends, just before and after
    cut = tmp_path / "cut.perftake"
    whole = read_take_file(tmp_path / "whole.perftake")
    for size in sorted({stop + by for stop in stops[:-1] for by in (-1, 0, 1)}):
        cut.write_bytes(data[:size])
        take = read_take_file(cut)
        kept = frames_of(take)
        assert kept == frames_of(whole)[: len(kept)]
        assert not take.complete
        assert take.problems
        assert all("take recover" in problem for problem in take.problems)
        assert not summarise(cut).complete


def test_every_flipped_bit_is_told_and_the_rest_is_read(tmp_path: Path, write: Write) -> None:
    data = write(tmp_path / "whole.perftake", 2, 1).read_bytes()
    chunks, _ = scan(data, "")
    starts = np.array([chunk.offset for chunk in chunks])
    rng = np.random.default_rng(0)
    headers = [c.offset + i for c in chunks for i in range(HEADER_BYTES)]
    positions = [*range(PREAMBLE_BYTES), *headers, *rng.integers(0, len(data), 600).tolist()]
    refused = 0
    for position in positions:
        damaged = bytearray(data)
        damaged[position] ^= 1 << int(rng.integers(8))
        try:
            found, faults = scan(bytes(damaged), "")
        except TakeError:
            assert position < PREAMBLE_BYTES
            refused += 1
            continue
        assert faults
        assert sum(fault.offset <= position < fault.offset + fault.size for fault in faults) == 1
        hit = int(np.searchsorted(starts, position, side="right")) - 1
        assert [chunk.offset for chunk in found] == [c.offset for i, c in enumerate(chunks) if i != hit]
    assert refused == 0  # one wrong bit of the version does not make a take of another version


def test_damage_is_told_with_what_is_lost(tmp_path: Path, write: Write) -> None:
    path = write(tmp_path / "a.perftake")
    data = bytearray(path.read_bytes())
    hit = [chunk for chunk in scan(bytes(data), "")[0] if chunk.kind == ChunkKind.FRAMES][1]
    data[hit.offset + HEADER_BYTES + 700] ^= 8
    path.write_bytes(data)
    take = read_take_file(path)
    assert not take.complete
    assert take.problems[0].startswith(f"chunk {hit.sequence} (frames) is damaged (byte {hit.offset}, ")
    assert take.problems[1].startswith("3 of 12 frames are lost")
    assert [frame.number for frame in take.frames] == [0, 1, 2, 6, 7, 8, 9, 10, 11]
    # the calibration and the subject are there twice
    first = scan(path.read_bytes(), "")[0][0]
    data[first.offset + HEADER_BYTES + 5] ^= 1
    path.write_bytes(data)
    assert read_take_file(path).setup.subjects()[0].name == "Anna"


def test_bytes_that_are_missing_or_zero_in_the_middle_are_told(tmp_path: Path, write: Write) -> None:
    data = write(tmp_path / "a.perftake").read_bytes()
    chunks, _ = scan(data, "")
    third, fourth, sixth = chunks[3], chunks[4], chunks[6]
    for broken, lost in (
        (data[: third.offset + 100] + data[third.offset + 900 :], {3}),
        (data[: third.offset] + data[fourth.offset :], {3}),
        (data[: third.offset + 10] + bytes(sixth.offset - third.offset) + data[sixth.offset + 10 :], {3, 4, 5, 6}),
        (data + bytes(4096), set()),
    ):
        found, faults = scan(broken, "")
        assert faults
        assert {c.sequence for c in chunks} - {c.sequence for c in found} == lost


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "is empty"),
        (b"no take at all, but some words", "is no recorded take"),
        (os.urandom(5000), "is no recorded take"),
        (preamble()[:7], "cut off before anything was recorded"),
    ],
)
def test_other_files_are_refused(tmp_path: Path, content: bytes, message: str) -> None:
    (tmp_path / "a.perftake").write_bytes(content)
    for read in (read_take_file, summarise):
        with pytest.raises(TakeError, match=message):
            read(tmp_path / "a.perftake")
    with pytest.raises(PerfanimError, match="cannot be read"):
        read_take_file(tmp_path / "none.perftake")


def test_a_take_of_a_newer_program_is_told_as_one(
    tmp_path: Path, write: Write, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = write(tmp_path / "a.perftake", 2, 1)
    later = encode_chunk(99, len(read_take_file(path).chunks), b"something new")
    path.write_bytes(path.read_bytes() + later)
    assert read_take_file(path).complete  # what it does not know is passed over
    monkeypatch.setattr("perfanim.core.formats.take_file.chunks.VERSION", 2)
    path.write_bytes(preamble() + path.read_bytes()[PREAMBLE_BYTES:])
    monkeypatch.undo()
    with pytest.raises(TakeError, match="a take of version 2, this program reads 1"):
        read_take_file(path)


def test_notes_change_by_appending(tmp_path: Path, write: Write) -> None:
    path = write(tmp_path / "a.perftake")
    before = path.read_bytes()
    for rating in (3, 5):
        append_notes(path, TakeNotes("Gang 1", "Füße\ngut", rating, "Xbot"))
    assert path.read_bytes().startswith(before)
    take = read_take_file(path)
    assert take.complete
    assert take.notes == summarise(path).notes == TakeNotes("Gang 1", "Füße\ngut", 5, "Xbot")
    assert len(take.frames) == summarise(path).frames == 12
    # cut within the new notes, the recording is whole and the notes are the old ones
    path.write_bytes(path.read_bytes()[: len(before) + 40])
    cut = read_take_file(path)
    assert (cut.notes.name, len(cut.frames), cut.complete, cut.problems[0][:23]) == (
        "Walk 1", 12, False, "the file is cut off wit",
    )  # fmt: skip
    with pytest.raises(TakeError, match="no end mark; recover it first"):
        append_notes(path, TakeNotes("x"))
    with pytest.raises(TakeError, match="6 is out of range"):
        TakeNotes(rating=6)


def test_recover_keeps_all_that_is_intact(tmp_path: Path, write: Write) -> None:
    path = write(tmp_path / "a.perftake")
    data = path.read_bytes()
    chunks, _ = scan(data, "")
    path.write_bytes(data[: chunks[7].offset + 50])
    cut = path.read_bytes()
    recover(read_take_file(path), tmp_path / "b.perftake")
    take = read_take_file(tmp_path / "b.perftake")
    assert take.complete
    assert frames_of(take) == [frame_record(number) for number in range(9)]
    assert poses_of(take) == [pose_record(number) for number in range(6)]
    assert take.events == (
        f"recovered: the file is cut off within chunk 7 (poses) (byte {chunks[7].offset}, 50 bytes)",
    )
    assert summarise(tmp_path / "b.perftake").frames == 9
    assert path.read_bytes() == cut
    with pytest.raises(TakeError, match="would be overwritten"):
        recover(read_take_file(path), path)
    assert path.read_bytes() == cut
    path.write_bytes(data[: chunks[0].offset + 50])
    with pytest.raises(TakeError, match="has lost its calibration and subject"):
        recover(read_take_file(path), tmp_path / "c.perftake")
    assert not (tmp_path / "c.perftake").exists()


def test_a_take_being_written_is_locked_and_can_be_read(
    tmp_path: Path, setup: TakeSetup, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(writer_module, "WRITE_EVERY_S", 3600.0)  # the test plays the thread
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

    monkeypatch.setattr(writer_module, "WRITE_EVERY_S", 3600.0)  # the test plays the thread
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


def test_a_disk_that_stays_full_costs_no_more_memory_than_allowed(
    tmp_path: Path, setup: TakeSetup, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(writer_module, "WRITE_EVERY_S", 3600.0)
    monkeypatch.setattr(writer_module, "MOST_WAITING", 5000)
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


def test_a_setup_without_a_part_is_refused(setup: TakeSetup) -> None:
    facts = json.loads(setup.to_json())
    assert TakeSetup.from_json(json.dumps(facts | {"weather": "fine"}).encode(), "") == setup
    for part in ("rig", "subject", "settings", "database", "capture"):
        broken = {key: value for key, value in facts.items() if key != part}
        with pytest.raises(TakeError, match="incomplete"):
            TakeSetup.from_json(json.dumps(broken).encode(), "")
    for data in (b"[1]", b"\xff", b"{"):
        with pytest.raises(TakeError):
            TakeSetup.from_json(data, "")
    with pytest.raises(PerfanimError):
        replace(setup, rig={"cam_0": {"size": 3}}).camera_rig()
    with pytest.raises(PerfanimError):
        replace(setup, performers=(facts["subject"] | {"joint": [1]},)).subjects()


def test_props_are_part_of_the_setup(setup: TakeSetup) -> None:
    sword = load_prop("sword")
    facts = json.loads(replace(setup, props=(prop_tables(sword),)).to_json())
    (known,) = TakeSetup.from_json(json.dumps(facts).encode(), "").carried_props()
    assert (known.name, known.names) == (sword.name, sword.names)
    np.testing.assert_array_equal(known.positions_m, sword.positions_m)
    with pytest.raises(PropError, match="damaged"):
        replace(setup, props=(facts["props"][0] | {"marker": [1]},)).carried_props()
    with pytest.raises(TakeError, match="incomplete"):
        TakeSetup.from_json(json.dumps(facts | {"props": 5}).encode(), "")


def test_a_take_may_have_no_performer(tmp_path: Path, setup: TakeSetup) -> None:
    bare = replace(setup, performers=())
    assert json.loads(bare.to_json())["subject"] == {}
    assert TakeSetup.from_json(bare.to_json(), "") == bare and bare.subjects() == ()
    write_whole_take(tmp_path / "bare.perftake", bare, TakeNotes("Bare"), [], [])
    listed = summarise(tmp_path / "bare.perftake")
    assert (listed.notes.name, listed.performers, listed.marker_set) == ("Bare", (), "")
    with pytest.raises(TakeError, match="has no poses; perfanim solve labels and solves it"):
        read_take_file(tmp_path / "bare.perftake").recorded_poses_of()


def test_further_performers_are_part_of_the_setup(setup: TakeSetup) -> None:
    (worn,) = setup.subjects()
    facts = json.loads(replace(setup, performers=2 * setup.performers).to_json())
    assert facts["performers"] == [facts["subject"]]
    _, known = TakeSetup.from_json(json.dumps(facts).encode(), "").subjects()
    assert (known.name, known.marker_set.names) == (worn.name, worn.marker_set.names)
    np.testing.assert_array_equal(known.skeleton.offsets_m, worn.skeleton.offsets_m)
    with pytest.raises(SubjectError, match="damaged"):
        replace(setup, performers=(*setup.performers, setup.performers[0] | {"joint": [1]})).subjects()
