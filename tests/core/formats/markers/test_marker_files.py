import struct
from pathlib import Path

import numpy as np
import pytest
from perfanim.core.errors import FormatError, PerfanimError
from perfanim.core.formats.markers.marker_files import declared_frames, read_take, write_take
from perfanim.core.markers.marker_take import MarkerTake

TRC = (
    "PathFileType\t4\t(X/Y/Z)\ta.trc\n"
    "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames\n"
    "100\t100\t3\t2\tcm\t100\t1\t3\n"
    "Frame#\tTime\tA\t\t\tB\t\t\n"
    "\t\tX1\tY1\tZ1\tX2\tY2\tZ2\n"
    "\n"
    "1\t0.00\t10\t20\t30\t\t\t\n"
    "2\t0.01\t11\t2.1e1\t31\tNaN\tnan\tNAN\n"
    "3\t0.02\t12\t22\t32\t1\t2\t3\n"
)
MOTIVE = (
    "Format Version,1.23,Take Name,T,Capture Frame Rate,120,Export Frame Rate,60,Length Units,Millimeters\n"
    "\n"
    ",Type,Rigid Body,Rigid Body,Rigid Body,Marker,Marker,Marker,Marker,Marker,Marker\n"
    ",Name,R,R,R,R:A,R:A,R:A,R:B,R:B,R:B\n"
    ",ID,1,1,1,2,2,2,3,3,3\n"
    ",,Position,Position,Position,Position,Position,Position,Position,Position,Position\n"
    "Frame,Time (Seconds),X,Y,Z,X,Y,Z,X,Y,Z\n"
    "0,0.0,9,9,9,1,2,3,4,5,6\n"
    "1,0.0167,9,9,9,1,2,3,,,\n"
)
QUALISYS = (
    "NO_OF_FRAMES\t3\nNO_OF_CAMERAS\t8\nNO_OF_MARKERS\t2\nFREQUENCY\t200\nNO_OF_ANALOG\t0\nANALOG_FREQUENCY\t0\n"
    "DESCRIPTION\t--\nTIME_STAMP\t2022-06-02, 15:49:44.620\t25975.4\nDATA_INCLUDED\t3D\n"
    "MARKER_NAMES\tL Hand\tHead\n"
)


def example(frames: int = 6) -> MarkerTake:
    generator = np.random.default_rng(2)
    positions = generator.normal(0.0, 1.0, (frames, 3, 3))
    positions[2, 1] = np.nan
    return MarkerTake("example", 59.94, ("HEAD", "L HAND", "R.FOOT"), positions, np.arange(10, 10 + frames))


@pytest.mark.parametrize("ending", [".take.npz", ".csv", ".trc"])
def test_round_trip(tmp_path: Path, ending: str) -> None:
    take = example()
    write_take(take, tmp_path / f"a{ending}")
    again = read_take(tmp_path / f"a{ending}")
    assert again.names == take.names
    assert again.fps == pytest.approx(take.fps)
    np.testing.assert_allclose(again.positions_m, take.positions_m, atol=1e-6)
    np.testing.assert_array_equal(again.frame_numbers, take.frame_numbers)
    np.testing.assert_allclose(again.times_s, take.times_s, atol=1e-6)


def test_trc_units_blanks_and_nan(tmp_path: Path) -> None:
    (tmp_path / "a.trc").write_text(TRC)
    take = read_take(tmp_path / "a.trc")
    assert take.names == ("A", "B")
    np.testing.assert_array_equal(take.visible, [[True, False], [True, False], [True, True]])
    np.testing.assert_allclose(take.positions_m[:, 0, 1], [0.20, 0.21, 0.22])


def test_trc_rate_zero_is_taken_from_the_times(tmp_path: Path) -> None:
    (tmp_path / "a.trc").write_text(TRC.replace("100\t100\t3", "0\t0\t3"))
    assert read_take(tmp_path / "a.trc").fps == 100.0


def test_motive_export(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(MOTIVE)
    take = read_take(tmp_path / "a.csv")
    assert take.names == ("A", "B")
    assert take.fps == 60.0
    np.testing.assert_allclose(take.positions_m[0], [[0.001, 0.002, 0.003], [0.004, 0.005, 0.006]])
    np.testing.assert_array_equal(take.visible[1], [True, False])


def test_markers_of_several_bodies_are_told_apart_in_a_motive_export(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(MOTIVE.replace("R:A", "Arm:Marker1").replace("R:B", "Leg:Marker1"))
    assert read_take(tmp_path / "a.csv").names == ("Arm:Marker1", "Leg:Marker1")


@pytest.mark.parametrize(
    ("more", "rows", "times_s"),
    [
        ("", ["100\t200\t-300\t\t\t", "110\t2e2\t0\t0\t0\t0", "120\t200\t0\t1\t2\t3"], [0.0, 0.005, 0.01]),
        (
            "TRAJECTORY_TYPES\tMeasured\tMixed\nEVENT\tstart\t7\t0.035\n"
            "Frame\tTime\tL Hand X\tL Hand Y\tL Hand Z\tHead X\tHead Y\tHead Z\n",
            [
                "7\t0.030\t100\t200\t-300\tNULL\tNULL\tNULL\t",
                "8\t0.035\t110\t200\t0\t\t\t\t",
                "9\t0.040\t120\t200\t0\t1\t2\t3\t",
            ],
            [0.03, 0.035, 0.04],
        ),
    ],
)
def test_qualisys_export(tmp_path: Path, more: str, rows: list[str], times_s: list[float]) -> None:
    (tmp_path / "a.tsv").write_text(QUALISYS + more + "\n".join(rows) + "\n", newline="\r\n")
    take = read_take(tmp_path / "a.tsv")
    assert (take.names, take.fps) == (("L Hand", "Head"), 200.0)
    np.testing.assert_array_equal(take.visible, [[True, False], [True, False], [True, True]])
    np.testing.assert_allclose(take.positions_m[:, 0], [[0.1, 0.2, -0.3], [0.11, 0.2, 0.0], [0.12, 0.2, 0.0]])
    np.testing.assert_allclose(take.times_s, times_s)
    assert declared_frames(tmp_path / "a.tsv") == 3


@pytest.mark.parametrize(
    ("name", "text", "part"),
    [
        ("a.trc", "", "is not a TRC file"),
        ("a.trc", TRC[:90], "ends within its header"),
        ("a.trc", TRC.replace("2.1e1", "x"), "line 8: has a field that is not a number"),
        ("a.trc", TRC.replace("\tcm\t", "\tfurlong\t"), "unknown unit of length 'furlong'"),
        ("a.trc", TRC.replace("A\t\t\tB", "\t\t\t"), "has no markers"),
        ("a.trc", TRC.replace("3\t2\tcm", "3\t1\tcm"), "declares 1 markers, names 2"),
        ("a.trc", TRC.replace("12\t22\t32\t1\t2\t3", "12\t22\t32\t1\t2\t3\t4"), "line 9: has fields beyond"),
        ("a.trc", TRC[: TRC.index("1\t0.00")], "has no frames"),
        ("a.csv", "", "is empty"),
        ("a.csv", "time,speed\n1,2\n", "is not a marker take"),
        ("a.csv", "frame,time_s,A_x,A_y,A_z\n1,0,1,2,q\n", "line 2: has a field that is not a number"),
        ("a.csv", "frame,A_x,A_y,A_z\n1,1,2,3\n", "neither fps nor times"),
        ("a.csv", "frame,time_s,A_x,A_y,A_z\n1,0,1,2,3,4\n", "line 2: has more than 5 fields"),
        ("a.csv", MOTIVE[: MOTIVE.index("0,0.0")], "has no frames"),
        ("a.csv", MOTIVE.replace("Marker", "Camera"), "has no markers"),
        ("a.tsv", "frame\tspeed\n1\t2\n", "is not a marker export of Qualisys"),
        ("a.tsv", QUALISYS, "has no frames"),
        ("a.tsv", QUALISYS + "1\t2\t3\t4\t5\n", "line 11: has 5 fields, not 6"),
        ("a.tsv", QUALISYS + "1\t2\t3\t4\t5\t6\n1\t2\tx\t4\t5\t6\n", "line 12: has a field that is not a number"),
        ("a.tsv", QUALISYS.replace("\t3D", "\t6D") + "1\t2\t3\t4\t5\t6\n", "holds no 3D data"),
        ("a.tsv", QUALISYS.replace("\tHead", "") + "1\t2\t3\n", "declares 2 markers and names 1"),
        ("a.tsv", QUALISYS.replace("\t200\n", "\t0\n") + "1\t2\t3\t4\t5\t6\n", "gives neither a frame rate nor times"),
        ("a.c3d", "", "is empty"),
        ("a.c3d", "x" * 3000, "is not a C3D file"),
        ("a.c3d", "\x02P" + "\0" * 700, "is cut off within its header"),
        ("a.xyz", "x", "is not a marker take"),
        ("a.take.npz", "junk", "is not a marker take"),
    ],
)
def test_damaged_files_are_refused_in_one_line(tmp_path: Path, name: str, text: str, part: str) -> None:
    (tmp_path / name).write_text(text)
    with pytest.raises(PerfanimError) as caught:
        read_take(tmp_path / name)
    assert part in str(caught.value)
    assert str(tmp_path / name) in str(caught.value)


def test_missing_file(tmp_path: Path) -> None:
    for name in ("a.trc", "a.csv", "a.c3d", "a.take.npz"):
        with pytest.raises(PerfanimError):
            read_take(tmp_path / name)


def _c3d(order: str, processor: int, real: bool) -> bytes:
    """Return a small C3D file: two points, three frames, POINT:LABELS and POINT:UNITS."""
    parameters = bytearray(struct.pack("BBBB", 1, 80, 2, processor))

    def group(number: int, name: bytes) -> None:
        parameters.extend(struct.pack("bb", len(name), -number) + name + struct.pack(order + "hB", 3, 0))

    def parameter(number: int, name: bytes, kind: int, shape: list[int], content: bytes) -> None:
        body = struct.pack("bB", kind, len(shape)) + bytes(shape) + content + b"\0"
        parameters.extend(struct.pack("bb", len(name), number) + name + struct.pack(order + "h", 2 + len(body)) + body)

    group(1, b"POINT")
    parameter(1, b"LABELS", -1, [4, 2], b"HEADHAND")
    parameter(1, b"UNITS", -1, [2], b"cm")
    parameter(1, b"USED", 2, [], struct.pack(order + "h", 2))
    parameters.extend(bytes(1024 - len(parameters)))
    scale = -0.1 if real else 0.1
    header = struct.pack("BB", 2, 80) + struct.pack(order + "HHHHH", 2, 0, 1, 3, 0)
    header += struct.pack(order + "fHHf", scale, 4, 0, 50.0)
    data = []
    for frame in range(3):
        for point in range(2):
            values = [100 + frame, 200 + point, -300, -1 if (frame, point) == (1, 1) else 0]
            scaled_values = [v * 0.1 if i < 3 else v for i, v in enumerate(values)] if real else values
            data.append(struct.pack(order + ("4f" if real else "4h"), *scaled_values))
    return header + bytes(512 - len(header)) + bytes(parameters) + b"".join(data)


@pytest.mark.parametrize(("order", "processor"), [("<", 84), (">", 86)])
@pytest.mark.parametrize("real", [True, False])
def test_c3d_of_each_processor(tmp_path: Path, order: str, processor: int, real: bool) -> None:
    (tmp_path / "a.c3d").write_bytes(_c3d(order, processor, real))
    take = read_take(tmp_path / "a.c3d")
    assert take.names == ("HEAD", "HAND")
    assert take.fps == 50.0
    np.testing.assert_array_equal(take.visible, [[True, True], [True, False], [True, True]])
    np.testing.assert_allclose(take.positions_m[2], [[0.102, 0.200, -0.3], [0.102, 0.201, -0.3]], atol=1e-7)


def test_every_cut_of_a_c3d_file_is_read_or_refused(tmp_path: Path) -> None:
    content = _c3d("<", 84, True)
    frames = set()
    for end in range(0, len(content) + 1, 16):
        (tmp_path / "a.c3d").write_bytes(content[:end])
        try:
            frames.add(read_take(tmp_path / "a.c3d").frames)
        except FormatError:
            frames.add(0)
    assert frames == {0, 1, 2, 3}


def test_damaged_bytes_never_end_in_a_traceback(tmp_path: Path) -> None:
    generator = np.random.default_rng(0)
    content = np.frombuffer(_c3d("<", 84, False), dtype=np.uint8)
    refused = 0
    for _ in range(300):
        damaged = content.copy()
        places = generator.integers(0, 700, 12)
        damaged[places] = generator.integers(0, 256, 12)
        (tmp_path / "a.c3d").write_bytes(damaged.tobytes())
        try:
            assert read_take(tmp_path / "a.c3d").frames > 0
        except FormatError:
            refused += 1
    assert refused > 0
