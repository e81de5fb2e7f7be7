import time
from pathlib import Path

import numpy as np
import pytest
from perfanim.core.errors import CaptureError, FormatError
from perfanim.core.formats.take_file import take_writer
from perfanim.core.formats.take_file.take_reader import read_take_file
from perfanim.core.formats.take_file.take_setup import TakeSetup
from perfanim.core.formats.take_file.take_writer import record_frames
from perfanim.core.markers.marker_frame import MarkerFrame


def frames(count):
    for number in range(count):
        blobs = np.full((3, 5), number, dtype=np.float32)
        yield MarkerFrame(number, number / 30.0, blobs=(blobs, blobs))


def test_frames_are_in_the_file_while_others_are_to_come(tmp_path: Path, setup: TakeSetup) -> None:
    """What a killed process would leave can be read."""
    seen = []

    def watched():
        yield from frames(20)
        (path,) = tmp_path.iterdir()
        while not read_take_file(path).frames:
            time.sleep(take_writer.SETTINGS.write_every_s)
        seen.append(read_take_file(path))
        yield MarkerFrame(20, 20 / 30.0)

    path = record_frames(tmp_path / "walk.perftake", setup, watched())
    (cut,) = seen
    assert not cut.complete and [frame.number for frame in cut.frames] == list(range(20))
    take = read_take_file(path)
    assert take.complete and len(take.frames) == 21 and take.setup == setup and take.notes.name == "walk"
    np.testing.assert_array_equal(take.frames[7].blobs[1], 7.0)


def test_an_error_leaves_nothing_but_what_cannot_be_seen_again(tmp_path: Path, setup: TakeSetup) -> None:
    def broken():
        yield from frames(5)
        raise CaptureError("gives no images", where="camera left", advice="check its cable")

    with pytest.raises(CaptureError, match="check its cable"):
        record_frames(tmp_path / "walk.perftake", setup, broken())
    assert not list(tmp_path.iterdir())
    with pytest.raises(
        CaptureError, match=r"camera left: gives no images; the frames recorded before are in .*unfinished"
    ):
        record_frames(tmp_path / "walk.perftake", setup, broken(), keep_cut=True)
    (path,) = tmp_path.iterdir()
    take = read_take_file(path)
    assert take.complete and len(take.frames) == 5 and "gives no images" in take.events[0]


def test_a_full_disk_is_an_error(tmp_path: Path, setup: TakeSetup, monkeypatch: pytest.MonkeyPatch) -> None:
    def full():
        yield from frames(3)

        def no_space(handle: int, data: bytes) -> int:
            raise OSError(28, "No space left on device")

        monkeypatch.setattr(take_writer.os, "write", no_space)

    with pytest.raises(FormatError, match="No space left on device"):
        record_frames(tmp_path / "walk.perftake", setup, full())
    assert not list(tmp_path.iterdir())
