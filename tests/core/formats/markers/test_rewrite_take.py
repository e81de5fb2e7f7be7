"""Marker files written again with some positions changed: the rest stays as it is."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from perfanim.core.errors import FormatError
from perfanim.core.formats.markers.c3d import layout_of
from perfanim.core.formats.markers.marker_files import read_take, write_take
from perfanim.core.formats.markers.rewrite_take import rewrite_take
from perfanim.core.markers.marker_take import MarkerTake

SAMPLES = Path("c3d/BTKData/c3d.org/sample02")


def changed(take: MarkerTake, frames: slice, marker: int) -> tuple[MarkerTake, np.ndarray]:
    """Return a take with a marker somewhere else in some frames, and which (F, M) have changed."""
    positions = take.positions_m.copy()
    where = np.zeros(take.visible.shape, dtype=bool)
    where[frames, marker] = True
    positions[where] = np.nan_to_num(positions[where]) + np.array([0.012, -0.034, 0.056])
    return MarkerTake(take.name, take.fps, take.names, positions, take.frame_numbers, take.times_s), where


@pytest.mark.parametrize(
    "name", ["pc_real.c3d", "pc_int.c3d", "Dec_real.c3d", "DEC_INT.C3D", "sgi_real.c3d", "sgi_int.c3d"]
)
def test_only_what_has_changed_is_written(shared_dir: Path, tmp_path: Path, name: str) -> None:
    source, target = shared_dir / SAMPLES / name, tmp_path / "a.c3d"
    take = read_take(source)
    new, where = changed(take, slice(20, 40), 5)
    assert rewrite_take(source, new, target) == []
    again = read_take(target)
    scale = layout_of(source.read_bytes(), name).scale
    half_step_m = max(0.5e-3 * scale, 0.0) + 1e-6  # of integers; a micrometre for what single precision keeps
    np.testing.assert_array_equal(again.positions_m[~where], take.positions_m[~where])
    np.testing.assert_allclose(again.positions_m[where], new.positions_m[where], atol=half_step_m)
    assert (again.names, again.fps) == (take.names, take.fps)
    before, after = source.read_bytes(), target.read_bytes()
    word = 2 if "int" in name.lower() else 4
    assert len(before) == len(after)
    assert sum(a != b for a, b in zip(before, after, strict=True)) <= 20 * 4 * word


def test_another_reader_finds_the_rest_unchanged(shared_dir: Path, tmp_path: Path) -> None:
    ezc3d = pytest.importorskip("ezc3d")
    source = shared_dir / "c3d" / "ezc3d-testFiles" / "BTS.c3d"
    take = read_take(source)
    marker = int(np.argmin(take.visible.mean(axis=0)))
    gap = np.flatnonzero(~take.visible[:, marker])[:5]
    positions = take.positions_m.copy()
    positions[gap, marker] = [1.0, 2.0, 3.0]
    new = MarkerTake(take.name, take.fps, take.names, positions, take.frame_numbers, take.times_s)
    rewrite_take(source, new, tmp_path / "a.c3d")
    before, after = (ezc3d.c3d(str(path)) for path in (source, tmp_path / "a.c3d"))
    points = after["data"]["points"][:3, marker, gap].T * 1e-3
    np.testing.assert_allclose(points, positions[gap, marker], atol=1e-6)
    assert np.all(after["data"]["meta_points"]["residuals"][0, marker, gap] == 0.0)
    np.testing.assert_array_equal(before["data"]["analogs"], after["data"]["analogs"])
    others = np.ones(before["data"]["points"].shape[1:], dtype=bool)
    others[marker, gap] = False
    np.testing.assert_array_equal(before["data"]["points"][:, others], after["data"]["points"][:, others])
    for group, parameters in before["parameters"].items():
        for name, parameter in parameters.items():
            if name != "__METADATA__":
                np.testing.assert_array_equal(parameter["value"], after["parameters"][group][name]["value"])


def test_a_position_that_integers_cannot_hold_is_refused(shared_dir: Path, tmp_path: Path) -> None:
    source = shared_dir / SAMPLES / "pc_int.c3d"
    take = read_take(source)
    take.positions_m[3, 4] = [50.0, 0.0, 0.0]
    with pytest.raises(FormatError, match="is too large for the file's integers"):
        rewrite_take(source, take, tmp_path / "a.c3d")
    assert not any(tmp_path.iterdir())


def test_rows_of_a_trc_file_keep_what_is_in_them(tmp_path: Path) -> None:
    lines = [
        "PathFileType\t4\t(X/Y/Z)\ta.trc", "DataRate\tNumMarkers\tUnits", "100\t3\tmm",
        "Frame#\tTime\tA\t\t\tB", "\t\tX1",
        "1\t0.00\t1.50\t2.5\t3.5\t4\t5\t6\t70\t71\t72", "2\t0.01\t1.5\t2.5\t3.5", "3\t0.02\tNaN\tNaN\tNaN\t4\t5\t6",
    ]  # fmt: skip
    (tmp_path / "a.trc").write_bytes("\r\n".join(lines).encode() + b"\n")
    take = read_take(tmp_path / "a.trc")
    take.positions_m[1, 1] = [0.007, 0.008, 0.009]
    take.positions_m[2, 0] = [0.001, 0.002, 0.003]
    assert rewrite_take(tmp_path / "a.trc", take, tmp_path / "b.trc") == []
    lines[6] += "\t7.00000\t8.00000\t9.00000"
    lines[7] = "3\t0.02\t1.00000\t2.00000\t3.00000\t4\t5\t6"
    assert (tmp_path / "b.trc").read_bytes() == "\r\n".join(lines).encode() + b"\n"


def test_what_another_format_loses_is_told(shared_dir: Path, tmp_path: Path) -> None:
    source = shared_dir / SAMPLES / "pc_real.c3d"
    take = read_take(source)
    (lost,) = rewrite_take(source, take, tmp_path / "a.trc")
    assert lost == "not written: analog samples, events, parameters, residuals of pc_real.c3d; a .c3d keeps them"
    np.testing.assert_allclose(read_take(tmp_path / "a.trc").positions_m, take.positions_m, atol=1e-8)
    write_take(take, tmp_path / "own.csv")
    assert rewrite_take(tmp_path / "own.csv", take, tmp_path / "b.csv")
    shutil.copy(tmp_path / "a.trc", tmp_path / "c.trc")
    assert rewrite_take(tmp_path / "c.trc", take, tmp_path / "c.csv") == []
