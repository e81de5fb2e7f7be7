from pathlib import Path

import numpy as np
import pytest
from perfanim.core.errors import FormatError
from perfanim.core.formats.markers.marker_files import read_take, write_take
from perfanim.core.markers.marker_take import MarkerTake


def a_take(frames: int, numbers: np.ndarray, names: tuple[str, ...] = ("HEAD", "L HAND", "Fuß")) -> MarkerTake:
    positions = np.random.default_rng(2).normal(0.0, 1.0, (frames, len(names), 3))
    positions[1, 1] = np.nan
    return MarkerTake("example", 59.94, names, positions, numbers)


@pytest.mark.parametrize("first", [1, 200])
def test_round_trip(tmp_path: Path, first: int) -> None:
    take = a_take(6, np.arange(first, first + 6))
    write_take(take, tmp_path / "a.c3d")
    again = read_take(tmp_path / "a.c3d")
    assert again.names == take.names
    assert again.fps == pytest.approx(take.fps)
    np.testing.assert_allclose(again.positions_m, take.positions_m, atol=1e-6)
    np.testing.assert_array_equal(again.frame_numbers, take.frame_numbers)


def test_frames_that_are_lost_are_frames_without_markers(tmp_path: Path) -> None:
    write_take(a_take(4, np.array([0, 1, 4, 5])), tmp_path / "a.c3d")
    again = read_take(tmp_path / "a.c3d")
    np.testing.assert_array_equal(again.frame_numbers, [1, 2, 3, 4, 5, 6])
    np.testing.assert_array_equal(again.visible[:, 0], [True, True, False, False, True, True])


@pytest.mark.parametrize("frames", [5, 70_000])
def test_another_reader_agrees(tmp_path: Path, frames: int) -> None:
    ezc3d = pytest.importorskip("ezc3d")
    take = a_take(frames, np.arange(frames))
    write_take(take, tmp_path / "a.c3d")
    other = ezc3d.c3d(str(tmp_path / "a.c3d"))
    point = other["parameters"]["POINT"]
    assert point["LABELS"]["value"] == list(take.names)
    assert point["UNITS"]["value"] == ["mm"]
    assert point["RATE"]["value"][0] == pytest.approx(take.fps)
    points = other["data"]["points"][:3].transpose(2, 1, 0) * 1e-3
    assert points.shape == take.positions_m.shape
    np.testing.assert_allclose(points, take.positions_m, atol=1e-6)


def test_more_markers_than_fit_are_refused(tmp_path: Path) -> None:
    names = tuple(f"M{i}" for i in range(256))
    with pytest.raises(FormatError, match="256 markers do not fit, because a C3D file holds at most 255"):
        write_take(a_take(2, np.arange(2), names), tmp_path / "a.c3d")
    assert not any(tmp_path.iterdir())
