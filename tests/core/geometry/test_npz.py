"""Archives of arrays from anywhere: nothing hostile reaches NumPy's parser or memory."""

import io
import struct
import subprocess
import sys
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pytest
from perfanim.core.errors import FormatError, TakeError
from perfanim.core.geometry.npz import open_zip, read_arrays, write_arrays
from perfanim.core.markers.marker_take import MarkerTake, load_take, save_take

ARRAYS = {
    "text": np.array(["a", "longer \u00e4"]),
    "number": np.array(60.0),
    "cube": np.arange(24.0).reshape(2, 3, 4),
    "fortran": np.asfortranarray(np.arange(6.0).reshape(2, 3)),
    "flags": np.array([True, False]),
    "small": np.arange(5, dtype=np.uint8),
    "big": np.arange(4, dtype=">i4"),
    "none": np.zeros((0, 3)),
}


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_arrays_written_by_numpy_are_read(tmp_path: Path, save) -> None:
    save(tmp_path / "a.npz", **ARRAYS)
    found = read_arrays(tmp_path / "a.npz")
    assert set(found) == set(ARRAYS)
    for name, array in ARRAYS.items():
        assert found[name].dtype == array.dtype
        np.testing.assert_array_equal(found[name], array)


@pytest.mark.parametrize("packed", [True, False])
def test_arrays_are_readable_by_numpy(tmp_path: Path, packed: bool) -> None:
    for name in ("a.npz", "b.npz"):
        write_arrays(tmp_path / name, ARRAYS | {"list": [1.5, 2.5]}, packed)
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    with np.load(tmp_path / "a.npz") as found:
        assert set(found) == {*ARRAYS, "list"}
        for name, array in ARRAYS.items():
            assert found[name].dtype == array.dtype
            np.testing.assert_array_equal(found[name], array)


FULL = """
import resource, signal, sys
import numpy as np
from perfanim.core.errors import FormatError
from perfanim.core.geometry.npz import write_arrays
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
arrays = {name: np.random.default_rng(seed).random(6000) for seed, name in enumerate("ab")}
for most in (0, 100, 3000, 40000, 80000):
    resource.setrlimit(resource.RLIMIT_FSIZE, (most, resource.RLIM_INFINITY))
    try:
        write_arrays(sys.argv[1], arrays)
    except FormatError as error:
        sys.stderr.write(f"{error}\\n")
"""


@pytest.mark.skipif(sys.platform == "win32", reason="has no quota for a process")
def test_full_quota_is_an_error_and_keeps_the_old_file(tmp_path: Path) -> None:
    (tmp_path / "a.npz").write_text("old")
    done = subprocess.run([sys.executable, "-c", FULL, str(tmp_path / "a.npz")], stderr=subprocess.PIPE, text=True)
    lines = done.stderr.splitlines()
    assert len(lines) == 5
    assert all("a.npz: cannot be written (File too large); free some space" in line for line in lines)
    assert (tmp_path / "a.npz").read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["a.npz"]


def _npy(descr: str = "'<f8'", shape: str = "(2, 3)", data: bytes = bytes(48), head: bytes = b"") -> bytes:
    text = head or f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}\n".encode()
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + data


HOSTILE = {
    "objects": _npy("'|O'"),
    "structure": _npy("[('a', '<f8')]"),
    "larger shape": _npy(shape="(2, 4)"),
    "negative shape": _npy(shape="(-2, 3)"),
    "endless shape": _npy(shape="(" + "9, " * 30 + ")"),
    "huge shape": _npy(shape="(999999999999999, 999999999999999)"),
    "no header": b"",
    "text": b"hello",
    "code": _npy(head=b"{'descr': __import__('os').getcwd(), 'fortran_order': False, 'shape': (), }\n"),
    "nested": _npy(head=b"(" * 60000 + b"\n"),
    "strange type": _npy("'<f3'"),
}


@pytest.mark.parametrize("member", HOSTILE.values(), ids=HOSTILE)
def test_hostile_members_are_refused(tmp_path: Path, member: bytes) -> None:
    save_take(MarkerTake("a", 60.0, ("A",), np.zeros((4, 1, 3))), tmp_path / "a.take.npz")
    for replaced in ("positions_m", "names", "kind", "fps"):
        with zipfile.ZipFile(tmp_path / "a.take.npz") as good, zipfile.ZipFile(tmp_path / "b.npz", "w") as bad:
            for name in good.namelist():
                bad.writestr(name, member if name == f"{replaced}.npy" else good.read(name))
        with pytest.raises(TakeError, match=r"b\.npz: is not a marker take"):
            load_take(tmp_path / "b.npz")


@pytest.mark.parametrize("packing", [zipfile.ZIP_LZMA, zipfile.ZIP_BZIP2])
def test_other_compressions_are_refused(tmp_path: Path, packing: int) -> None:
    with zipfile.ZipFile(tmp_path / "a.npz", "w", packing) as archive:
        archive.writestr("a.npy", _npy())
    with pytest.raises(FormatError, match="compressed by an unknown method"):
        read_arrays(tmp_path / "a.npz")


def test_small_file_that_unpacks_to_much_takes_no_memory(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.npz", "w", zipfile.ZIP_DEFLATED) as archive:
        for number in range(2):
            archive.writestr(f"{number}.npy", _npy(shape=f"({5 << 20},)", data=bytes(40 << 20)))
    resource = pytest.importorskip("resource")  # not on Windows
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    with pytest.raises(FormatError, match="declares far more data than it holds"):
        read_arrays(tmp_path / "a.npz")
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before < 8 << 10


def _list_only(path: Path, members: int, declared: int, is_large: bool = False) -> None:
    """Write a zip archive that is only a list of members of one byte's name, with any number declared."""
    listed = (b"PK\x01\x02" + bytes(24) + b"\x01" + bytes(17) + b"a") * members
    size, place = len(listed), 0
    end = b""
    if is_large:
        end = b"PK\x06\x06" + struct.pack("<QHHIIQQQQ", 44, 45, 45, 0, 0, declared, declared, size, place)
        end += b"PK\x06\x07" + struct.pack("<IQI", 0, size, 1)
        declared, size, place = 0xFFFF, 0xFFFFFFFF, 0xFFFFFFFF
    path.write_bytes(listed + end + b"PK\x05\x06" + struct.pack("<HHHHIIH", 0, 0, declared, declared, size, place, 0))


@pytest.mark.parametrize(("declared", "is_large"), [(1, False), (0xFFFF, False), (200_000, True), (1, True)])
def test_a_list_of_many_members_takes_no_memory(tmp_path: Path, declared: int, is_large: bool) -> None:
    _list_only(tmp_path / "a.npz", 200_000, declared, is_large)
    tracemalloc.start()
    with pytest.raises(FormatError, match=r"a\.npz: declares far more data than it holds; export it again"):
        read_arrays(tmp_path / "a.npz")
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 1 << 20


@pytest.mark.parametrize("members", [1, 199, 200, 201])
def test_members_are_counted_as_zipfile_lists_them(tmp_path: Path, members: int) -> None:
    _list_only(tmp_path / "a.npz", members, members)
    counts: list[int] = []
    with (tmp_path / "a.npz").open("rb") as file, open_zip(file, counts.append) as archive:
        assert len(archive.infolist()) == members == counts[-1]
    np.savez(tmp_path / "b.npz", **{str(number): np.zeros(1) for number in range(members)})
    if members > 200:
        with pytest.raises(FormatError, match="far more"):
            read_arrays(tmp_path / "b.npz")
    else:
        assert len(read_arrays(tmp_path / "b.npz")) == members


def test_an_archive_in_an_archive_is_not_counted(tmp_path: Path) -> None:
    _list_only(tmp_path / "a.zip", 5000, 5000)
    held = np.frombuffer((tmp_path / "a.zip").read_bytes(), np.uint8)
    np.savez(tmp_path / "b.npz", held=held)
    np.testing.assert_array_equal(read_arrays(tmp_path / "b.npz")["held"], held)


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("fps", np.array(np.inf)),
        ("fps", np.array([60.0, 60.0])),
        ("fps", np.array("sixty")),
        ("names", np.array("A")),
        ("names", np.arange(3)),
        ("positions_m", np.zeros((4, 3))),
        ("positions_m", np.array([["x"] * 3])),
        ("times_s", np.array(["a"] * 4)),
        ("times_s", np.zeros((4, 2))),
        ("times_s", np.full(4, np.nan)),
        ("frame_numbers", np.zeros(3)),
        ("frame_numbers", np.full(4, np.inf)),
        ("version", np.array(np.nan)),
        ("single_cameras", np.zeros((4, 1), dtype=np.int64)),
    ],
)
def test_members_of_wrong_type_or_shape_are_refused(tmp_path: Path, key: str, value: np.ndarray) -> None:
    save_take(MarkerTake("a", 60.0, ("A",), np.zeros((4, 1, 3))), tmp_path / "a.take.npz")
    arrays = read_arrays(tmp_path / "a.take.npz") | {key: value}
    np.savez(tmp_path / "b.take.npz", **arrays)
    with pytest.raises(TakeError):
        load_take(tmp_path / "b.take.npz")


def test_an_archive_that_is_cut_off_or_changed_is_refused_or_harmless(tmp_path: Path) -> None:
    content = io.BytesIO()
    np.savez_compressed(content, **ARRAYS)
    whole, random = content.getvalue(), np.random.default_rng(0)
    for _ in range(300):
        damaged = bytearray(whole[: random.integers(len(whole)) if random.random() < 0.3 else None])
        for place in random.integers(max(len(damaged), 1), size=random.integers(1, 6)) if damaged else ():
            damaged[place] = random.integers(256)
        (tmp_path / "a.npz").write_bytes(damaged)
        try:
            found = read_arrays(tmp_path / "a.npz")
        except FormatError:
            continue
        assert sum(array.nbytes for array in found.values()) < 1 << 20
