import zipfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from perfanim.core.errors import TakeError
from perfanim.core.markers.marker_take import MarkerTake, SingleViews, load_take, save_take
from perfanim.core.simulate.studio.studio_rig import default_rig


def small() -> MarkerTake:
    positions = np.random.default_rng(0).normal(size=(40, 3, 3))
    positions[3:9, 1] = np.nan
    return MarkerTake("wälk", 59.94, ("A", "B", "Ümlaut"), positions)


def test_round_trip(tmp_path: Path) -> None:
    take = small()
    save_take(take, tmp_path / "a.take.npz")
    again = load_take(tmp_path / "a.take.npz")
    assert (again.name, again.fps, again.names) == (take.name, take.fps, take.names)
    np.testing.assert_array_equal(again.positions_m, take.positions_m)
    np.testing.assert_array_equal(again.frame_numbers, np.arange(40))
    np.testing.assert_array_equal(again.times_s, np.arange(40) / 59.94)
    assert [path.name for path in tmp_path.iterdir()] == ["a.take.npz"]


def test_numbers_and_times_with_dropped_frames_are_kept(tmp_path: Path) -> None:
    numbers = np.concatenate((np.arange(20), np.arange(25, 45)))
    take = MarkerTake("a", 30.0, ("A",), np.zeros((40, 1, 3)), numbers)
    np.testing.assert_allclose(take.times_s, numbers / 30.0)
    save_take(take, tmp_path / "a.take.npz")
    np.testing.assert_array_equal(load_take(tmp_path / "a.take.npz").frame_numbers, numbers)


def test_single_views_are_kept_with_their_cameras(tmp_path: Path) -> None:
    rig = default_rig()
    cameras = np.full((40, 3), -1)
    cameras[3:9, 1] = 1
    points = np.where((cameras >= 0)[..., None], [0.25, -0.1], np.nan)
    take = replace(small(), single=SingleViews(rig, cameras, points))
    save_take(take, tmp_path / "a.take.npz")
    again = load_take(tmp_path / "a.take.npz").single
    assert again is not None
    np.testing.assert_array_equal(again.cameras, cameras)
    np.testing.assert_array_equal(again.points, points)
    for mine, other in zip(again.rig.cameras, rig.cameras, strict=True):
        assert (mine.name, mine.image_size) == (other.name, other.image_size)
        for part in ("matrix", "distortion", "rotation", "translation_m"):
            np.testing.assert_array_equal(getattr(mine, part), getattr(other, part))
    with pytest.raises(TakeError, match="do not match the markers"):
        replace(take, single=SingleViews(rig, cameras[:5], points[:5]))
    with pytest.raises(TakeError, match="not in the rig of 2"):
        replace(take, single=SingleViews(rig, cameras * 2, points))


def test_visible() -> None:
    take = small()
    assert take.frames == 40
    assert take.visible.sum() == 40 * 3 - 6
    assert not take.visible[3:9, 1].any()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"names": ("A", "A", "B")}, "not unique"),
        ({"names": ()}, "at least one frame and one marker"),
        ({"names": ("A", "B")}, "shape"),
        ({"positions_m": np.zeros((0, 3, 3))}, "at least one frame"),
        ({"fps": 0.0}, "must be positive"),
        ({"fps": float("nan")}, "must be positive"),
        ({"frame_numbers": np.arange(7)}, "do not fit"),
        ({"times_s": np.arange(7.0)}, "do not fit"),
    ],
)
def test_inconsistent_takes_are_refused(change: dict[str, object], message: str) -> None:
    parts = {"name": "t", "fps": 60.0, "names": ("A", "B", "C"), "positions_m": np.zeros((5, 3, 3))}
    with pytest.raises(TakeError, match=f"t: .*{message}"):
        MarkerTake(**(parts | change))


def test_truncated_files_are_refused(tmp_path: Path) -> None:
    save_take(small(), tmp_path / "a.take.npz")
    whole = (tmp_path / "a.take.npz").read_bytes()
    broken = tmp_path / "b.take.npz"
    for length in [*range(0, len(whole), 97), len(whole) - 1]:
        broken.write_bytes(whole[:length])
        with pytest.raises(TakeError, match=r"b\.take\.npz: is not a marker take"):
            load_take(broken)


def test_other_files_are_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "array.npy", np.zeros(3))
    np.savez(tmp_path / "other.npz", a=np.zeros(3))
    np.savez(tmp_path / "objects.npz", kind=np.array(object()))
    with zipfile.ZipFile(tmp_path / "empty.npz", "w"):
        pass
    np.savez(tmp_path / "newer.npz", kind=np.array("perfanim marker take"), version=np.array(2))
    (tmp_path / "text.npz").write_text("hello")
    for path in sorted(tmp_path.iterdir()):
        with pytest.raises(TakeError, match=path.name):
            load_take(path)
    with pytest.raises(TakeError, match="nowhere"):
        load_take(tmp_path / "nowhere.npz")
    with pytest.raises(TakeError, match=tmp_path.name):
        load_take(tmp_path)
