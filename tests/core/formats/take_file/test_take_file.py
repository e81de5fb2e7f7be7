"""A take is what was put in; other files are refused, and its notes change by appending."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from perfanim.core.errors import TakeError
from perfanim.core.formats.take_file.append_notes import append_notes
from perfanim.core.formats.take_file.chunks import PREAMBLE_BYTES, encode_chunk, preamble
from perfanim.core.formats.take_file.take_reader import read_take_file, summarise, unused_path
from perfanim.core.formats.take_file.take_setup import TakeNotes, TakeSetup
from records import frame_record, frames_of, pose_record, poses_of

Write = Callable[..., Path]


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
    with pytest.raises(TakeError, match="a take of version 2, but this program reads version 1"):
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
    with pytest.raises(TakeError, match="was cut off; recover the take first"):
        append_notes(path, TakeNotes("x"))
    with pytest.raises(TakeError, match="6 is out of range"):
        TakeNotes(rating=6)


@pytest.mark.parametrize("name", ["x" * 300, "é" * 300, "\ud800" * 300, "a" * 199 + ". " * 50])
def test_a_take_with_a_long_name_gets_a_path_that_can_be_written(tmp_path: Path, name: str) -> None:
    first = unused_path(tmp_path, name)
    first.touch()
    second = unused_path(tmp_path, name)
    second.touch()
    assert first != second
    assert first.parent == second.parent == tmp_path
    assert name[:50].encode("utf-8", "replace").decode() == first.name[:50]


def test_names_of_takes_stay_as_they_are_but_for_what_no_file_can_have(tmp_path: Path) -> None:
    assert unused_path(tmp_path, "Änna 1: a/b?").name == "Änna 1- a-b-.perftake"
    assert unused_path(tmp_path, " . ").name == "take.perftake"
    nowhere = tmp_path / ("x" * 300)  # a folder that there cannot be
    assert unused_path(nowhere, "walk") == nowhere / "walk.perftake"
