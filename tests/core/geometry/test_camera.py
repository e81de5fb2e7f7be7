import tomllib
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from perfanim.core.errors import CalibrationError
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.camera import Camera, CameraRig, undistort_all
from perfanim.core.geometry.rig_file import load_rig, save_ignored, save_rig
from perfanim.core.system.files import read_toml, write_toml

MATRIX = np.array([[812.0, 0.0, 641.5], [0.0, 808.0, 355.2], [0.0, 0.0, 1.0]])
SIZED = "[cam_0]\nsize = [4, 4]\nmatrix = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]\n"
PLACED = "rotation = [0, 0, 0]\ntranslation = [0, 0, 0]\n"
LENSES = [np.zeros(5), np.array([-0.28, 0.09, 0.001, -0.0007, -0.012]), np.array([0.12, -0.2, -0.002, 0.001, 0.08])]


def camera(lens: int = 1, seed: int = 0, name: str = "left") -> Camera:
    generator = np.random.default_rng(seed)
    turn = rot.to_matrix(rot.from_rotation_vector(generator.normal(scale=0.5, size=3)))
    rotation = turn @ np.diag([1.0, -1.0, -1.0])
    return Camera(name, (1280, 720), MATRIX, LENSES[lens], rotation, generator.normal(size=3))


def points_before(view: Camera, seed: int = 1, count: int = 300) -> np.ndarray:
    """World points that fall into the image."""
    generator = np.random.default_rng(seed)
    depth = generator.uniform(0.5, 8.0, count)
    local = np.stack((generator.uniform(-0.7, 0.7, count) * depth, generator.uniform(-0.4, 0.4, count) * depth, depth))
    return (local.T - view.translation_m) @ view.rotation


@pytest.mark.parametrize("lens", range(3))
def test_projection_equals_opencvs(lens: int) -> None:
    view = camera(lens)
    points = points_before(view)
    expected, _ = cv2.projectPoints(points, cv2.Rodrigues(view.rotation)[0], view.translation_m, MATRIX, LENSES[lens])
    np.testing.assert_allclose(view.project(points), expected[:, 0], atol=1e-8)


def test_points_behind_the_camera_have_no_pixels() -> None:
    view = Camera("a", (64, 48), np.diag([50.0, 50.0, 1.0]))
    pixels = view.project([[0.0, 0.0, 2.0], [0.1, 0.0, -2.0], [0.0, 0.0, 0.0]])
    np.testing.assert_array_equal(pixels[0], [0.0, 0.0])
    assert np.isnan(pixels[1:]).all()


@pytest.mark.parametrize("lens", range(3))
def test_undistort_is_the_inverse(lens: int) -> None:
    view = camera(lens)
    points = points_before(view)
    local = view.to_camera(points)
    normalised = local[:, :2] / local[:, 2:]
    np.testing.assert_allclose(view.undistort(view.to_pixels(normalised)), normalised, atol=1e-6)
    grid = np.stack(np.meshgrid(np.linspace(0, 1279, 9), np.linspace(0, 719, 7)), axis=-1)
    back = view.to_pixels(view.undistort(grid))
    assert back.shape == (7, 9, 2)
    np.testing.assert_allclose(back, grid, atol=1e-3)  # thousandths of a pixel up to the corners


def test_pixels_of_several_cameras_are_undistorted_as_those_of_each() -> None:
    cameras = [camera(lens, seed=lens) for lens in range(3)]
    pixels = [view.project(points_before(view, count=count)) for view, count in zip(cameras, (5, 0, 12), strict=True)]
    for found, view, rows in zip(undistort_all(cameras, pixels), cameras, pixels, strict=True):
        np.testing.assert_allclose(found, view.undistort(rows), atol=1e-9)


def test_undistort_accepts_nan_and_empty_arrays() -> None:
    view = camera()
    assert view.undistort(np.empty((0, 2))).shape == (0, 2)
    result = view.undistort([[np.nan, np.nan], [700.0, 300.0]])
    assert np.isnan(result[0]).all()
    np.testing.assert_allclose(view.to_pixels(result[1]), [700.0, 300.0], atol=1e-6)


def test_skewed_pixels() -> None:
    skewed = MATRIX + np.array([[0.0, 3.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    view = Camera("a", (1280, 720), skewed, LENSES[1])
    pixels = np.array([[100.0, 650.0], [900.0, 20.0]])
    np.testing.assert_allclose(view.to_pixels(view.undistort(pixels)), pixels, atol=1e-3)


def test_rays_lead_to_the_points() -> None:
    view = camera()
    points = points_before(view)
    local = view.to_camera(points)
    rays = view.rays(local[:, :2] / local[:, 2:])
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1.0)
    along = np.linalg.norm(points - view.centre_m, axis=1, keepdims=True)
    np.testing.assert_allclose(view.centre_m + along * rays, points, atol=1e-12)
    np.testing.assert_allclose(view.to_camera(view.centre_m), 0.0, atol=1e-12)
    assert view.focal_px == 810.0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"matrix": np.eye(2)}, "matrix must be"),
        ({"matrix": np.diag([-5.0, 5.0, 1.0])}, "focal lengths must be positive"),
        ({"image_size": (0, 5)}, "must be positive"),
        ({"rotation": np.diag([1.0, 1.0, -1.0])}, "not a rotation"),
        ({"rotation": 2.0 * np.eye(3)}, "not a rotation"),
        ({"translation_m": np.array([0.0, np.nan, 0.0])}, "finite"),
        ({"distortion": np.full(5, np.inf)}, "finite"),
        ({"distortion": np.full(8, 0.1)}, "at most five"),
        ({"ignored_px": np.ones(4)}, "pairs"),
        ({"ignored_px": np.array([[1.0, np.nan]])}, "pairs"),
    ],
)
def test_impossible_cameras_are_refused(change: dict[str, object], message: str) -> None:
    parts = {"name": "c", "image_size": (64, 48), "matrix": MATRIX}
    with pytest.raises(CalibrationError, match=f"camera c: .*{message}"):
        Camera(**(parts | change))


def test_distortion_is_padded_to_five_coefficients() -> None:
    np.testing.assert_array_equal(Camera("a", (4, 4), MATRIX, np.array([0.1])).distortion, [0.1, 0, 0, 0, 0])
    long = np.array([0.1, 0.2, 0.3, 0.4, 0.5, 0.0, 0.0, 0.0])  # OpenCV's rational model with nothing in it
    np.testing.assert_array_equal(Camera("a", (4, 4), MATRIX, long).distortion, long[:5])
    with pytest.raises(CalibrationError, match="at least one camera"):
        CameraRig(())


def test_rig_round_trip_in_anipose_layout(tmp_path: Path) -> None:
    rig = CameraRig(tuple(camera(i % 3, i, f"cam {i}") for i in range(12)), {"error": 0.31, "date": "2024-05-01"})
    save_rig(rig, tmp_path / "rig.toml")
    again = load_rig(tmp_path / "rig.toml")
    assert again.metadata["error"] == 0.31
    for old, new in zip(rig.cameras, again.cameras, strict=True):  # twelve: cam_10 comes after cam_9
        assert (old.name, old.image_size) == (new.name, new.image_size)
        np.testing.assert_allclose(new.rotation, old.rotation, atol=1e-12)
        for name in ("matrix", "distortion", "translation_m"):
            np.testing.assert_array_equal(getattr(new, name), getattr(old, name))
    assert again.baseline_m() == pytest.approx(rig.baseline_m())
    table = tomllib.loads((tmp_path / "rig.toml").read_text())["cam_0"]
    assert set(table) == {"name", "size", "matrix", "distortions", "rotation", "translation"}
    np.testing.assert_allclose(np.array(table["rotation"]), cv2.Rodrigues(rig.cameras[0].rotation)[0].ravel())


@pytest.mark.parametrize("unit", ["none", "mm", "m"])
def test_millimetres_of_other_programs(tmp_path: Path, unit: str) -> None:
    rig = CameraRig((camera(0, 1), camera(0, 2)))
    save_rig(rig, tmp_path / "rig.toml")
    tables = read_toml(tmp_path / "rig.toml")
    if unit == "none":
        tables["metadata"] = {"adjusted": False, "error": 0.5}
    else:
        tables["metadata"]["length_unit"] = unit
    if unit != "m":
        for key in ("cam_0", "cam_1"):
            tables[key]["translation"] = [1000.0 * value for value in tables[key]["translation"]]
    write_toml(tmp_path / "mm.toml", tables)
    assert load_rig(tmp_path / "mm.toml").baseline_m() == pytest.approx(rig.baseline_m())


def test_ignored_places_are_kept_in_the_file_and_nothing_else_is_changed(tmp_path: Path) -> None:
    path, rig = tmp_path / "rig.toml", CameraRig((camera(), replace(camera(), name="right")), {"error": 0.25})
    save_rig(rig, path)
    before = path.read_text()
    places = np.array([(0, 12.5, 80.25), (1, 3.0, 4.0), (1, 600.0, 470.0)])
    save_ignored(path, places)
    loaded = load_rig(path)
    np.testing.assert_array_equal(loaded.ignored, places)
    np.testing.assert_array_equal(loaded.cameras[1].ignored_px, places[1:, 1:])
    save_rig(loaded, tmp_path / "again.toml")
    np.testing.assert_array_equal(load_rig(tmp_path / "again.toml").ignored, places)
    save_ignored(path, ())
    assert load_rig(path).ignored.shape == (0, 3)
    assert path.read_text() == before


def test_ignoring_replaces_the_ignored_places() -> None:
    rig = CameraRig((camera(), replace(camera(), name="right")))
    places = [(1, 3.0, 4.0), (0, 12.5, 80.25)]
    ignoring = rig.ignoring(places)
    np.testing.assert_array_equal(ignoring.ignored, [places[1], places[0]])
    np.testing.assert_array_equal(ignoring.ignoring(places[:1]).ignored, places[:1])
    assert ignoring.ignoring(()).ignored.shape == (0, 3)


def test_ignored_places_are_refused_in_other_programs_files(tmp_path: Path) -> None:
    path = tmp_path / "caliscope.toml"
    path.write_text("[cameras.0]\nsize = [640, 480]\n")
    with pytest.raises(CalibrationError, match="cannot hold ignored positions"):
        save_ignored(path, [(0, 1.0, 2.0)])
    assert path.read_text() == "[cameras.0]\nsize = [640, 480]\n"


def test_rotation_may_be_a_matrix(tmp_path: Path) -> None:
    save_rig(CameraRig((camera(),)), tmp_path / "rig.toml")
    tables = read_toml(tmp_path / "rig.toml")
    tables["cam_0"]["rotation"] = camera().rotation
    write_toml(tmp_path / "b.toml", tables)
    np.testing.assert_array_equal(load_rig(tmp_path / "b.toml").cameras[0].rotation, camera().rotation)


def test_a_plain_file_is_read(tmp_path: Path) -> None:
    (tmp_path / "rig.toml").write_text(SIZED + PLACED)
    assert load_rig(tmp_path / "rig.toml").cameras[0].image_size == (4, 4)
