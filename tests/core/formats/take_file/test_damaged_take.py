"""Cuts, wrong bits and missing bytes of a take are told, and the rest is read and recovered."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from perfanim.core.body.pose_notes import PoseNote
from perfanim.core.errors import FormatError, TakeError
from perfanim.core.formats.take_file.chunks import HEADER_BYTES, PREAMBLE_BYTES, ChunkKind, scan
from perfanim.core.formats.take_file.pose_codec import pack_solved, unpack_solved
from perfanim.core.formats.take_file.take_reader import read_take_file, summarise
from perfanim.core.formats.take_file.take_recovery import recover
from records import frame_record, frames_of, pose_record, poses_of

Write = Callable[..., Path]


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
    assert take.problems[1].startswith("the damaged part held 3 of 12 frames")
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
    with pytest.raises(FormatError, match="is an input and would be overwritten"):
        recover(read_take_file(path), path)
    assert path.read_bytes() == cut
    path.write_bytes(data[: chunks[0].offset + 50])
    with pytest.raises(TakeError, match="has lost its calibration and subject"):
        recover(read_take_file(path), tmp_path / "c.perftake")
    assert not (tmp_path / "c.perftake").exists()


def test_notes_that_are_no_text_cost_the_pose_nothing() -> None:
    solved = unpack_solved(pose_record(3))
    noted = pack_solved(replace(solved, pose=replace(solved.pose, notes=(PoseNote.hidden(["left hand"]),))))
    damaged = unpack_solved(noted.replace(b"hand", b"h\xffnd")).pose
    assert [note.text for note in damaged.notes] == ["left h\N{REPLACEMENT CHARACTER}nd hidden"]
    np.testing.assert_array_equal(damaged.performers[0].rotations, solved.pose.performers[0].rotations)
