import re
import struct
import time
from pathlib import Path

import numpy as np
import pytest
from perfanim.core.errors import FormatError
from perfanim.core.formats.markers.c3d import read_c3d
from perfanim.core.formats.markers.c3d_write import write_c3d
from perfanim.core.formats.markers.marker_files import read_take, write_take
from perfanim.core.formats.unique_names import unique_names
from perfanim.core.markers.marker_take import MarkerTake
from small_files import MOTIVE, QUALISYS, TRC


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


DOUBLED = TRC.replace("100\t100\t3\t2\tcm\t100", "100\t\t100\t\t3\t\t2\t\tcm\t100")
WHOLE = TRC.replace("30\t\t\t\n", "30\t4\t5\t6\n").replace("NaN\tnan\tNAN", "4\t5\t6").replace("2.1e1", "21")


@pytest.mark.parametrize("ending", ["\n", "\r\n"])
@pytest.mark.parametrize(
    "text",
    [
        DOUBLED,
        DOUBLED.replace("Rate\t", "Rate\t\t"),
        TRC.replace("\t", "\t\t"),
        TRC.replace("\t", ";"),
        TRC.replace("\t", ","),
        TRC.replace("2.1e1", "21").replace(".", ","),
        TRC.replace("2.1e1", "21").replace(".", ",").replace("\t", ";"),
    ],
    ids=["values doubled", "header doubled", "doubled", "semicolons", "commas", "decimal commas", "semicolons, commas"],
)
def test_trc_of_spreadsheets_is_read(tmp_path: Path, text: str, ending: str) -> None:
    for name, each in (("a.trc", TRC), ("b.trc", text.replace("\n", ending))):
        (tmp_path / name).write_bytes(each.encode())
    right, take = read_take(tmp_path / "a.trc"), read_take(tmp_path / "b.trc")
    assert (take.names, take.fps) == (right.names, right.fps)
    np.testing.assert_array_equal(take.positions_m, right.positions_m)
    np.testing.assert_array_equal(take.times_s, right.times_s)
    (tmp_path / "b.trc").write_bytes(re.sub(r"\b3(\W+2\W+cm)", r"13\1", text).encode())
    assert (take.cut_off_frames, read_take(tmp_path / "b.trc").cut_off_frames) == (0, 10)


def test_trc_with_blanks_for_tabs_must_hold_every_value(tmp_path: Path) -> None:
    (tmp_path / "a.trc").write_text(WHOLE)
    (tmp_path / "b.trc").write_text(WHOLE.replace("\t", "  "))
    np.testing.assert_array_equal(read_take(tmp_path / "b.trc").positions_m, read_take(tmp_path / "a.trc").positions_m)
    (tmp_path / "c.trc").write_text(TRC.replace("\t", " "))
    with pytest.raises(FormatError, match=r"c.trc, line 7: has 5 of 8 values; export it with tabs"):
        read_take(tmp_path / "c.trc")


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le"])
@pytest.mark.parametrize("ending", [".trc", ".csv", ".tsv"])
def test_takes_in_other_encodings_are_read(tmp_path: Path, ending: str, encoding: str) -> None:
    text = {".trc": TRC, ".csv": MOTIVE, ".tsv": QUALISYS + "1\t2\t3\t4\t5\t6\n"}[ending]
    (tmp_path / f"a{ending}").write_text(text)
    (tmp_path / f"b{ending}").write_bytes(text.encode(encoding))
    right, take = (read_take(tmp_path / f"{name}{ending}") for name in "ab")
    assert take.names == right.names
    np.testing.assert_array_equal(take.positions_m, right.positions_m)
    assert take.cut_off_frames == right.cut_off_frames


def test_thousands_are_not_taken_for_decimals(tmp_path: Path) -> None:
    (tmp_path / "a.trc").write_text(TRC.replace("\t20\t30", "\t1,234\t30.5"))
    with pytest.raises(FormatError, match="line 7: has a field that is not a number"):
        read_take(tmp_path / "a.trc")


def test_takes_that_were_cut_off_say_so(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(
        MOTIVE.replace("Export Frame Rate,60", "Export Frame Rate,60,Total Exported Frames,500")
    )
    take = read_take(tmp_path / "a.csv")
    assert (take.cut_off_frames, take.notes) == (498, ("a.csv was cut off: it holds 2 of 500 frames",))
    (tmp_path / "a.trc").write_text(TRC.replace("100\t100\t3\t2", "100\t100\t17263\t2"))
    assert read_take(tmp_path / "a.trc").notes == ("a.trc was cut off: it holds 3 of 17263 frames",)
    (tmp_path / "b.trc").write_text(TRC)
    assert read_take(tmp_path / "b.trc").notes == ()


@pytest.mark.parametrize(
    ("parameters", "frames"),
    [
        ({("TRIAL", "ACTUAL_START_FIELD"): [1, 0], ("TRIAL", "ACTUAL_END_FIELD"): [-31072, 1]}, 100_000),
        ({("POINT", "LONG_FRAMES"): [70_000.0]}, 70_000),
        ({("POINT", "LONG_FRAMES"): ["many"]}, 0),
        ({}, 0),
    ],
)
def test_frame_counts_that_do_not_fit_a_c3d_header(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, parameters: dict[tuple[str, str], list[float]], frames: int
) -> None:
    write_c3d(example(), tmp_path / "a.c3d")
    data = bytearray((tmp_path / "a.c3d").read_bytes())
    struct.pack_into("<HH", data, 6, 1, 0xFFFF)  # first and last frame
    (tmp_path / "a.c3d").write_bytes(data)
    monkeypatch.setattr("perfanim.core.formats.markers.c3d._C3dParser.parameters", lambda _: parameters)
    assert read_take(tmp_path / "a.c3d").cut_off_frames == max(frames - 6, 0)


@pytest.mark.parametrize(
    ("clock", "times"),
    [
        ("timestamp", (0, 40_000_000, 80_000_000)),
        ("timestamp_ns", (0, 40_000_000, 80_000_000)),
        ("Time (ms)", (100, 140, 180)),
        ("timestamps", (7.0, 7.04, 7.08)),
    ],
)
def test_columns_of_text_are_passed_over_and_times_have_units(
    tmp_path: Path, clock: str, times: tuple[float, ...]
) -> None:
    rows = [f"{time};\"{{'a': 0,5}}\";0,5;1;2" for time in map(str, times)]
    (tmp_path / "a.csv").write_text("\n".join([f"{clock};by_camera;A_x;A_y;A_z", *rows]).replace("0,5", "0.5"))
    take = read_take(tmp_path / "a.csv")
    assert (take.names, take.fps) == (("A",), 25.0)
    assert take.times_s[-1] - take.times_s[0] == pytest.approx(0.08)


def test_dates_are_the_same_times_in_every_zone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TZ", "America/New_York")
    time.tzset()
    hours = ("02:59:59.96", "03:00:00.00", "03:00:00.04")  # in New York clocks go forward to 03:00
    rows = [f"2026-03-08 {hour},0.5,1,2" for hour in hours]
    (tmp_path / "a.csv").write_text("\n".join(["timestamp,A_x,A_y,A_z", *rows]))
    take = read_take(tmp_path / "a.csv")
    monkeypatch.undo()
    time.tzset()
    assert take.fps == 25.0
    assert np.diff(take.times_s) == pytest.approx(0.04, abs=1e-6)


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
    assert take.cut_off_frames == 0
    (tmp_path / "a.tsv").write_text(QUALISYS.replace("NO_OF_FRAMES\t3", "NO_OF_FRAMES\t4") + more + "\n".join(rows))
    assert read_take(tmp_path / "a.tsv").cut_off_frames == 1


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


@pytest.mark.parametrize("ending", ["trc", "c3d", "csv", "take.npz"])
def test_a_take_can_be_written_under_a_name_that_is_no_text(tmp_path: Path, ending: str) -> None:
    take = MarkerTake("a\udcff", 60.0, ("A", "B\udcff"), np.ones((3, 2, 3)))
    write_take(take, tmp_path / f"a\udcff.{ending}")
    assert read_take(tmp_path / f"a\udcff.{ending}").names == ("A", "B\\udcff")
