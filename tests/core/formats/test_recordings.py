"""Every marker file of other systems in ../shared/data: read as another reader or its own rows say, or refused.

`pytest tests/core/formats/test_recordings.py -rP` prints the list of the files with what is in them.
"""

import csv
import re
import sys
import warnings
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from perfanim.core.errors import FormatError
from perfanim.core.formats.markers.marker_files import read_take
from perfanim.core.markers.marker_take import MarkerTake

TOO_MUCH_FOR_EZC3D = ("bad_parameter_section.c3d",)  # it asks for gigabytes, and half a minute, and gives up
METRES = {"mm": 1e-3, "cm": 1e-2, "m": 1.0, "mete": 1.0, "meters": 1.0}
ROUNDED_M = 1e-9  # other readers multiply in single precision, a micrometre at most a thousandth of that
REFUSED = {
    "c3d/BTKData/others/1123x01EMG.c3d": "has no points",
    "c3d/BTKData/others/Empty.c3d": "is empty",
    "c3d/ezc3d-testFiles/C3DRotationExample.c3d": "has no points",
    "c3d/ezc3d-testFiles/Kistler.c3d": "has no points",
    "trc/BTKData/TRCSamples/10002-20130626160334-Unnamed.trc": "has no markers with a name",
    "trc/BTKData/TRCSamples/10002-20130731010438-Unnamed.trc": "has no markers with a name",
    "trc/BTKData/TRCSamples/Empty.trc": "is not a TRC file",
    "trc/BTKData/TRCSamples/Truncated.trc": "ends within its header",
    "trc/decar_OptiTrack_csv/tests/dataset9/2020_07_30_23_29_08_trial9_position_180.csv": "is not a marker take",
}


@dataclass
class Expected:
    """What a file holds: rate, unit, labels (blank where a point has none), positions (F, M, 3) with NaN."""

    fps: float
    unit: str
    names: list[str]
    positions_m: np.ndarray
    source: str


def files(shared_dir: Path, folder: str) -> list[Path]:
    endings = (".c3d", ".trc", ".csv")
    return sorted(path for path in (shared_dir / folder).rglob("*") if path.suffix.lower() in endings)


def without_missing(positions: np.ndarray, missing: np.ndarray | None = None) -> np.ndarray:
    gone = ~np.isfinite(positions).all(axis=-1) | (positions == 0.0).all(axis=-1)
    return np.where((gone if missing is None else gone | missing)[..., None], np.nan, positions)


def by_ezc3d(path: Path) -> Expected | None:
    """Return what ezc3d reads; None where it cannot, or does not see that analog samples lie between the frames."""
    ezc3d = pytest.importorskip("ezc3d")
    if path.name in TOO_MUCH_FOR_EZC3D:
        return None
    try:
        other = ezc3d.c3d(str(path))
    except (RuntimeError, OSError, ValueError):
        return None
    point = other["parameters"]["POINT"]
    raw = path.read_bytes()[:12]
    if other["data"]["points"].size == 0 or (int.from_bytes(raw[4:6], "little") and not other["data"]["analogs"].size):
        return None
    unit = (point["UNITS"]["value"] or ["mm"])[0] or "mm"
    points = other["data"]["points"][:3].transpose(2, 1, 0) * METRES[unit]
    missing = other["data"]["meta_points"]["residuals"][0].T < 0
    names = list(point["LABELS"]["value"])[: points.shape[1]]
    return Expected(float(point["RATE"]["value"][0]), unit, names, without_missing(points, missing), "ezc3d")


def by_header(path: Path, take: MarkerTake) -> Expected:
    """Return what the fields of the header block say: millimetres, Intel or MIPS, real numbers or integers.

    Of the labels it is looked whether they stand in the file, one behind the other.
    """
    raw = path.read_bytes()
    for order in "<>":
        points, analog, first, last = np.frombuffer(raw, order + "u2", 4, 2).astype(int)
        scale, start, fps = (
            np.frombuffer(raw, order + kind, 1, at)[0] for kind, at in (("f4", 12), ("u2", 16), ("f4", 20))
        )
        if 1.0 < fps < 1000.0:
            break
    width, frames = 4 * points + analog, last - first + 1
    words = np.frombuffer(raw, order + ("f4" if scale < 0.0 else "i2"), width * frames, 512 * (int(start) - 1))
    words = words.reshape(frames, width)[:, : 4 * points].reshape(frames, points, 4).astype(float)
    positions = words[..., :3] * (float(scale) if scale > 0.0 else 1.0) * METRES["mm"]
    labels = [re.sub(r"_\d+$", "", name) if name.rpartition("_")[0] in take.names else name for name in take.names]
    assert re.search(rb"[ \0]*".join(re.escape(label.encode()) for label in labels), raw), path
    return Expected(float(fps), "mm", labels, without_missing(positions, words[..., 3] < 0.0), "its header's fields")


def by_rows(path: Path) -> Expected:
    """Return what the rows of a TRC file say."""
    lines = path.read_text("utf-8", errors="replace").splitlines()
    header = dict(zip(lines[1].split("\t"), lines[2].split("\t"), strict=False))
    names = [field.strip() for field in lines[3].split("\t")[2:] if field.strip()]
    rows = [line.split("\t") for line in lines[5:] if line.split("\t")[0].strip()]
    values = np.full((len(rows), 3 * len(names)), np.nan)
    for row, fields in zip(values, rows, strict=True):
        numbers = [float(field) if field.strip() else np.nan for field in fields[2 : 2 + 3 * len(names)]]
        row[: len(numbers)] = numbers
    unit = header["Units"]
    positions = values.reshape(len(rows), -1, 3) * METRES[unit]
    fps, step_s = float(header["DataRate"]), float(rows[1][1]) - float(rows[0][1])
    if not 0.5 < fps * step_s < 2.0:  # a take that was thinned out, with the header of before
        fps = 1.0 / step_s
    return Expected(fps, unit, names, without_missing(positions), "its rows")


def by_columns(path: Path) -> Expected:
    """Return what the columns of a Motive export say that are called "Marker", or "Rigid Body Marker" without these."""
    rows = list(csv.reader(path.open(encoding="utf-8-sig")))
    facts = dict(zip(rows[0][::2], rows[0][1::2], strict=False))
    kinds, names, _, measures, axes = rows[2:7]
    kind = "Marker" if "Marker" in kinds else "Rigid Body Marker"
    columns = [i for i, own in enumerate(kinds) if own == kind and measures[i] == "Position"]
    assert [axes[i] for i in columns] == ["X", "Y", "Z"] * (len(columns) // 3)
    table = np.array([[float(row[i] or "nan") for i in columns] for row in rows[7:]])
    unit = facts["Length Units"].lower()
    positions = table.reshape(len(table), -1, 3) * METRES[unit]
    labels = [names[i].rpartition(":")[2] for i in columns[::3]]
    return Expected(float(facts["Export Frame Rate"]), unit, labels, without_missing(positions), "its columns")


def expected_of(path: Path, take: MarkerTake) -> Expected:
    if path.suffix.lower() == ".trc":
        return by_rows(path)
    if path.suffix.lower() == ".csv":
        return by_columns(path)
    return by_ezc3d(path) or by_header(path, take)


def labels_agree(names: tuple[str, ...], labels: list[str]) -> bool:
    """Whether names are the labels; one that repeats has a count behind it, a blank one is unnamed."""
    given = [label.strip() or "unnamed" for label in labels]
    told = [name if name == label else re.sub(r"_\d+$", "", name) for name, label in zip(names, given, strict=False)]
    return told == given


@pytest.mark.parametrize("folder", ["c3d", "trc"])
def test_every_file_is_read_with_its_values_or_refused(shared_dir: Path, folder: str) -> None:
    paths = files(shared_dir, folder)
    assert len(paths) >= {"c3d": 69, "trc": 30}[folder]
    refused, lines = {}, ["| file | frames | markers | Hz | unit | seen | the same as |\n|---|---|---|---|---|---|---|"]
    for path in paths:
        name = path.relative_to(shared_dir).as_posix()
        try:
            take = read_take(path)
        except FormatError as error:
            refused[name] = str(error)
            assert "\n" not in str(error)
            assert str(path) in str(error)
            lines.append(f"| {name} | refused: {str(error).replace(str(path), '').strip(',: ')} | | | | | |")
            continue
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # files of old systems hold signalling NaN
            expected = expected_of(path, take)
        np.testing.assert_allclose(take.positions_m, expected.positions_m, rtol=0.0, atol=ROUNDED_M, err_msg=name)
        assert take.fps == pytest.approx(expected.fps, rel=1e-6), name
        assert labels_agree(take.names, expected.names), name
        count = f"{take.frames} of {take.frames + take.cut_off_frames}" if take.cut_off_frames else str(take.frames)
        lines.append(
            f"| {name} | {count} | {len(take.names)} | {take.fps:.5g} | {expected.unit} "
            f"| {100.0 * take.visible.mean():.1f} % | {expected.source} |"
        )
    sys.stdout.write("\n".join(["", *lines, ""]))
    assert set(refused) == {name for name in REFUSED if name.startswith(folder)}
    for name, reason in refused.items():
        assert REFUSED[name] in reason
