"""Archives that declare more than they hold: linear work, bounded memory."""

import struct
import sys
import tarfile
import tracemalloc
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from perfanim.core.errors import FormatError
from perfanim.core.formats.motion.motion_sources import motion_files


def test_an_archive_that_holds_far_more_than_its_size(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        for number in range(9):
            archive.writestr(f"{number}.bvh", bytes(10 << 20))
    with pytest.raises(FormatError, match="far more than its size"), motion_files([tmp_path / "a.zip"]):
        pass


def _calls(function: Callable[[], object]) -> int:
    """Return how many calls of functions some work takes."""
    counts = {"call": 0, "c_call": 0}

    def count(_: object, event: str, __: object) -> None:
        if event in counts:
            counts[event] += 1

    sys.setprofile(count)
    try:
        function()
    finally:
        sys.setprofile(None)
    return sum(counts.values())


def _list(path: Path) -> None:
    with motion_files([path]):
        pass


def test_skeletons_are_found_in_linear_work(tmp_path: Path) -> None:
    works = []
    for number in (100, 200):
        path = tmp_path / f"{number}.zip"
        with zipfile.ZipFile(path, "w") as archive:
            for index in range(number):
                archive.writestr(f"a/{index}.asf", b"")
                archive.writestr(f"b/x{index}_1.amc", b"")
        works.append(_calls(lambda path=path: _list(path)))
    assert works[1] < 2.2 * works[0]


def _tar(path: Path, names: list[str], **extra: Any) -> None:
    with tarfile.open(path, "w:gz", **extra) as archive:
        for name in names:
            archive.addfile(tarfile.TarInfo(name))


@pytest.mark.parametrize("ending", ["bvh", "txt"])
def test_an_archive_of_more_files_than_its_size_allows(tmp_path: Path, ending: str) -> None:
    names = [f"{number}.{ending}" for number in range(4000)]
    _tar(tmp_path / "a.tar.gz", names)
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        for name in names:
            archive.writestr(name, b"")
    for name in ("a.tar.gz", "a.zip"):
        with pytest.raises(FormatError, match="holds far more files than its size allows"):
            _list(tmp_path / name)
    _tar(tmp_path / "b.tar.gz", names[:900])
    with motion_files([tmp_path / "b.tar.gz"]) as files:
        assert len(files) == (900 if ending == "bvh" else 0)


def test_a_long_list_in_a_zip_archive_takes_no_memory(tmp_path: Path) -> None:
    listed = (b"PK\x01\x02" + bytes(24) + b"\x01" + bytes(17) + b"a") * 50_000
    end = b"PK\x05\x06" + struct.pack("<HHHHIIH", 0, 0, 1, 1, len(listed), 0, 0)
    (tmp_path / "a.zip").write_bytes(listed + end)
    tracemalloc.start()
    with pytest.raises(FormatError, match=r"a\.zip: holds far more files than its size allows"):
        _list(tmp_path / "a.zip")
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 1 << 20


def test_a_name_in_a_tar_archive_that_is_larger_than_the_archive(tmp_path: Path) -> None:
    _tar(tmp_path / "a.tar.gz", ["x" * 50_000_000 + ".bvh"], format=tarfile.GNU_FORMAT)
    assert (tmp_path / "a.tar.gz").stat().st_size < 100_000
    tracemalloc.start()
    with pytest.raises(FormatError, match="is a damaged archive"):
        _list(tmp_path / "a.tar.gz")
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 10 << 20
    _tar(tmp_path / "b.tar.gz", ["x" * 300 + ".bvh"])
    with motion_files([tmp_path / "b.tar.gz"]) as files:
        assert files[0].stem == "x" * 300
