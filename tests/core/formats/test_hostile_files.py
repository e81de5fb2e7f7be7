"""Files that declare more than they hold, or repeat one thing without end: linear work, bounded memory."""

import struct
import sys
import tarfile
import tracemalloc
import zipfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from perfanim.core.errors import FormatError
from perfanim.core.formats.markers.c3d import read_c3d
from perfanim.core.formats.markers.c3d_write import write_c3d
from perfanim.core.formats.markers.marker_files import read_take, write_take
from perfanim.core.formats.motion.amc import parse_amc_values
from perfanim.core.formats.motion.asf import parse_asf, read_asf
from perfanim.core.formats.motion.bvh import read_bvh
from perfanim.core.formats.motion.motion_sources import motion_files
from perfanim.core.formats.unique_names import unique_names
from perfanim.core.markers.marker_take import MarkerTake
from perfanim.core.system.files import SLACK_BYTES

ASF = """:units
length 1
:root
position 0 0 0
:bonedata
begin
name a
direction 0 1 0
length 1
dof rx
end
:hierarchy
begin
root a
end
"""


def test_repeated_names_are_numbered_in_linear_time() -> None:
    assert unique_names(["a", "b", "a", "a_2", "a", "b"]) == ("a", "b", "a_2", "a_2_2", "a_3", "b_2")
    assert unique_names(["a_2", "a", "a"]) == ("a_2", "a", "a_3")
    many = unique_names(["x"] * 300_000)
    assert (len(set(many)), many[-1]) == (300_000, "x_300000")


@pytest.mark.parametrize("points", [8000, 65_535])
def test_a_c3d_file_of_many_points_without_names(tmp_path: Path, points: int) -> None:
    write_c3d(MarkerTake("a", 60.0, ("A",), np.ones((3, 1, 3))), tmp_path / "a.c3d")
    data = bytearray((tmp_path / "a.c3d").read_bytes())
    place = data.index(b"USED") + 4
    (offset,) = struct.unpack_from("<h", data, place)
    struct.pack_into("<h", data, place + 4, points - 65_536 if points > 32_767 else points)
    struct.pack_into("<H", data, 2, points)
    assert offset > 0
    (tmp_path / "b.c3d").write_bytes(bytes(data) + bytes(16 * points * 2))
    take = read_c3d(tmp_path / "b.c3d")
    assert len(take.names) == points
    assert take.names[-1] == f"unnamed_{points - 1}"


@pytest.mark.parametrize("number", [float("inf"), float("nan"), 1e30])
def test_a_c3d_parameter_that_is_no_count(tmp_path: Path, number: float) -> None:
    write_c3d(MarkerTake("a", 60.0, ("A",), np.ones((3, 1, 3))), tmp_path / "a.c3d")
    data = bytearray((tmp_path / "a.c3d").read_bytes())
    place = data.index(b"USED") + 6
    data[place : place + 2] = struct.pack("<bB", 4, 0)
    data[place + 2 : place + 6] = struct.pack("<f", number)
    (tmp_path / "a.c3d").write_bytes(data)
    with pytest.raises(FormatError):
        read_c3d(tmp_path / "a.c3d")


def _bvh(joints: int = 0, frame_time: str = "0.02", values: str = "0 0 0") -> bytes:
    own = "OFFSET 0 1 0\nCHANNELS 3 Zrotation Xrotation Yrotation\n"
    children = f"JOINT a {{\n{own}}}\n" * joints
    row = " ".join([values] * (joints + 1))
    return (
        f"HIERARCHY\nROOT a {{\n{own}{children}}}\nMOTION\nFrames: 2\nFrame Time: {frame_time}\n{row}\n{row}\n".encode()
    )


@pytest.mark.parametrize("frame_time", ["1e-300", "1e300", "inf", "nan", "0", "1e-9", "9" * 5000])
def test_a_bvh_rate_beyond_all_cameras(frame_time: str) -> None:
    with pytest.raises(FormatError, match="Frame Time"):
        read_bvh(_bvh(frame_time=frame_time))


def test_a_bvh_file_of_many_joints_of_one_name() -> None:
    assert read_bvh(_bvh(1500)).names[-1] == "a_1501"
    with pytest.raises(FormatError, match="has more than 2000 joints"):
        read_bvh(_bvh(20_000))
    with pytest.raises(FormatError, match="not a finite number"):
        read_bvh(_bvh(values="1" * 200_000 + "x 0 0"))


def test_an_asf_file_of_many_bones() -> None:
    start, end = ASF.index("begin"), ASF.index(":hierarchy")
    bones = "".join(ASF[start:end].replace("name a", f"name b{i}") for i in range(3000))
    with pytest.raises(FormatError, match="3001 bones"):
        parse_asf(ASF.replace(":hierarchy", bones + ":hierarchy").encode(), "x.asf")


@pytest.mark.parametrize(
    "filling", [b" " * 200_000, b"\t " * 100_000, b"1" * 200_000, b"\n " * 100_000, b"1 " * 100_000]
)
def test_an_amc_file_of_blanks_and_digits(filling: bytes) -> None:
    asf = parse_asf(ASF.encode(), "x.asf")
    for content in (filling, b"1\nroot 0 0 0 0 0 0\na 1\n" + filling + b"x", b"1\nroot 0 0 0 0 0 0\na 1" + filling):
        try:
            parse_amc_values(content, "x.amc", asf)
        except FormatError as error:
            assert len(str(error)) <= 300


def _trc(names: int, rows: int) -> str:
    header = "PathFileType\t4\t(X/Y/Z)\ta\nDataRate\tNumFrames\tNumMarkers\tUnits\n60\t1\t1000000\tmm\n"
    return header + "Frame#\tTime\t" + "\t".join(f"M{i}" for i in range(names)) + "\n\n" + "1\t0\n" * rows


def _csv(names: int, rows: int) -> str:
    header = ["frame", "time_s", *(f"M{i}_{axis}" for i in range(names) for axis in "xyz")]
    return "# fps=60\n" + ",".join(header) + "\n" + "1,0\n" * rows


def _still(channels: str, joints: int, frames: int) -> str:
    """A motion of a root with these channels, of joints without any, and of a number a frame."""
    children = "".join(f"JOINT a{index}\n{{\nOFFSET 0 1 0\nCHANNELS 0\n}}\n" for index in range(joints))
    root = f"ROOT a\n{{\nOFFSET 0 1 0\nCHANNELS {channels}\n{children}}}\n"
    return f"HIERARCHY\n{root}MOTION\nFrames: 2\nFrame Time: 0.02\n" + "0\n" * frames


def _read_amc(path: Path) -> None:
    parse_amc_values(path.read_bytes(), "x.amc", parse_asf(ASF.encode(), "x.asf"))


REPEATED = {
    "turning root.bvh": _still("1 Xrotation", 0, 500_000),
    "joints without numbers.bvh": _still("1 Xrotation", 300, 480_000),
    "frame numbers.amc": "1\nroot 0 0 0 0 0 0\na 1\n" + "2\n]\n[" * 200_000,
    "last line.asf": ASF + "end\n" * 250_000,
    "names.csv": "# fps=60\nframe,time_s," + ",".join(["M_x,M_y,M_z"] * 80_000) + "\n1,0\n",
    "blank lines.csv": _csv(1, 0) + "\n" * 1_000_000,
    "short rows.csv": _csv(5, 0) + "1\n" * 500_000,
}


@pytest.mark.parametrize("name", REPEATED)
def test_a_part_repeated_to_a_megabyte_takes_no_more_than_allowed(name: str, tmp_path: Path) -> None:
    text, path = REPEATED[name], tmp_path / name
    path.write_text(text)
    read = {".bvh": read_bvh, ".asf": read_asf, ".csv": read_take, ".amc": _read_amc}[path.suffix]
    tracemalloc.start()
    with suppress(FormatError):
        read(path)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 4 * len(text) + SLACK_BYTES


@pytest.mark.parametrize(("ending", "text"), [("trc", _trc(50_000, 50_000)), ("csv", _csv(20_000, 50_000))])
def test_a_table_that_is_only_declared_takes_no_memory(tmp_path: Path, ending: str, text: str) -> None:
    (tmp_path / f"a.{ending}").write_text(text)
    with pytest.raises(FormatError, match="far more than it holds"):
        read_take(tmp_path / f"a.{ending}")


def test_an_archive_that_holds_far_more_than_its_size(tmp_path: Path) -> None:
    with zipfile.ZipFile(tmp_path / "a.zip", "w", zipfile.ZIP_DEFLATED) as archive:
        for number in range(9):
            archive.writestr(f"{number}.bvh", bytes(10 << 20))
    with pytest.raises(FormatError, match="far more than its own size"), motion_files([tmp_path / "a.zip"]):
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
        with pytest.raises(FormatError, match="holds far more files than its own size"):
            _list(tmp_path / name)
    _tar(tmp_path / "b.tar.gz", names[:900])
    with motion_files([tmp_path / "b.tar.gz"]) as files:
        assert len(files) == (900 if ending == "bvh" else 0)


def test_a_long_list_in_a_zip_archive_takes_no_memory(tmp_path: Path) -> None:
    listed = (b"PK\x01\x02" + bytes(24) + b"\x01" + bytes(17) + b"a") * 50_000
    end = b"PK\x05\x06" + struct.pack("<HHHHIIH", 0, 0, 1, 1, len(listed), 0, 0)
    (tmp_path / "a.zip").write_bytes(listed + end)
    tracemalloc.start()
    with pytest.raises(FormatError, match=r"a\.zip: holds far more files than its own size"):
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


@pytest.mark.parametrize("ending", ["trc", "c3d", "csv", "take.npz"])
def test_a_take_can_be_written_under_a_name_that_is_no_text(tmp_path: Path, ending: str) -> None:
    take = MarkerTake("a\udcff", 60.0, ("A", "B\udcff"), np.ones((3, 2, 3)))
    write_take(take, tmp_path / f"a\udcff.{ending}")
    assert read_take(tmp_path / f"a\udcff.{ending}").names == ("A", "B\\udcff")
