"""Calibrations of other programs: made files with known cameras, and files that others published."""

from pathlib import Path

import numpy as np
import pytest
from perfanim.core.errors import PerfanimError
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.camera import Camera, CameraRig
from perfanim.core.geometry.rig_file import load_rig
from perfanim.core.geometry.rig_import import level_from_world
from perfanim.core.system.files import write_toml

LENS = np.array([-0.2, 0.05, 0.001, -0.002, 0.01])


def looking_camera(name: str, centre: np.ndarray, target: np.ndarray) -> Camera:
    """A level camera in a world with y up."""
    forward = (target - centre) / np.linalg.norm(target - centre)
    right = np.cross(forward, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    rotation = np.stack((right, np.cross(forward, right), forward))
    matrix = np.array([[900.0, 0.0, 650.0], [0.0, 910.0, 350.0], [0.0, 0.0, 1.0]])
    return Camera(name, (1280, 720), matrix, LENS, rotation, -rotation @ centre)


@pytest.fixture
def rig() -> CameraRig:
    target = np.array([0.1, 1.0, 0.2])
    places = [[-1.0, 1.4, 3.0], [1.2, 1.2, 2.9], [3.0, 1.9, 0.3]]
    return CameraRig(tuple(looking_camera(f"c{i}", np.array(p), target) for i, p in enumerate(places)))


def check_alike(read: CameraRig, rig: CameraRig) -> None:
    """The same cameras in the same place to each other, and upright: a point above another is above it."""
    for i in range(3):
        np.testing.assert_allclose(read.cameras[i].matrix, rig.cameras[i].matrix, atol=1e-6)
        np.testing.assert_allclose(read.cameras[i].distortion, LENS, atol=1e-9)
        assert read.cameras[i].image_size == (1280, 720)
        assert read.baseline_m(0, i) == pytest.approx(rig.baseline_m(0, i), rel=1e-6)
        relative = [r.cameras[i].rotation @ r.cameras[0].rotation.T for r in (read, rig)]
        np.testing.assert_allclose(relative[0], relative[1], atol=1e-6)
        up = [r.cameras[i].rotation[:, 1] for r in (read, rig)]
        np.testing.assert_allclose(up[0], up[1], atol=1e-6)


Z_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""World with z up from ours: x stays, y becomes z."""


def qualisys_text(rig: CameraRig, left: int = 0) -> str:
    """What Qualisys would write: z up, millimetres, 64ths of pixels, the camera's y up and z backwards."""
    rows = []
    for camera in rig.cameras:
        axes = (np.diag([1.0, -1.0, -1.0]) @ camera.rotation @ Z_UP.T).ravel()
        turn = " ".join(f'r{n // 3 + 1}{n % 3 + 1}="{v:.12f}"' for n, v in enumerate(axes))
        x, y, z = 1000.0 * Z_UP @ camera.centre_m
        m, d = 64.0 * camera.matrix, camera.distortion
        rows.append(
            f'<camera active="1" serial="{camera.name}">'
            f'<fov_video left="{left}" top="0" right="{left + 1279}" bottom="719"/>'
            f'<transform x="{x:.9f}" y="{y:.9f}" z="{z:.9f}" {turn}/>'
            f'<intrinsic focalLengthU="{m[0, 0]}" focalLengthV="{m[1, 1]}" centerPointU="{m[0, 2] + 64 * left}" '
            f'centerPointV="{m[1, 2]}" skew="0" radialDistortion1="{d[0]}" radialDistortion2="{d[1]}" '
            f'radialDistortion3="{d[4]}" tangentalDistortion1="{d[2]}" tangentalDistortion2="{d[3]}"/></camera>'
        )
    return f"<?xml version='1.0'?><calibration><cameras>{''.join(rows)}</cameras></calibration>"


@pytest.mark.parametrize("left", [0, 320])
def test_qualisys(rig: CameraRig, tmp_path: Path, left: int) -> None:
    path = tmp_path / "Calib.qca.txt"
    path.write_text(qualisys_text(rig, left))
    read = load_rig(path)
    check_alike(read, rig)
    for old, new in zip(rig.cameras, read.cameras, strict=True):
        np.testing.assert_allclose(new.centre_m, old.centre_m, atol=1e-6)  # this z-up world is ours turned about x
        assert new.name == old.name


@pytest.mark.parametrize("vectors", [False, True])
def test_caliscope(rig: CameraRig, tmp_path: Path, vectors: bool) -> None:
    tables = {}
    for i, camera in enumerate(rig.cameras):
        rotation = camera.rotation @ Z_UP.T
        tables[str(i + 1)] = {
            "cam_id": i + 1,
            "ignore": False,
            "size": list(camera.image_size),
            "matrix": camera.matrix,
            "distortions": LENS,
            "translation": camera.translation_m,
            "rotation": rot.to_rotation_vector(rot.from_matrix(rotation)) if vectors else rotation,
        }
    tables["9"] = {"ignore": True}
    write_toml(tmp_path / "camera_array.toml", {"cameras": tables})
    read = load_rig(tmp_path / "camera_array.toml")
    check_alike(read, rig)
    assert [camera.name for camera in read.cameras] == ["cam_1", "cam_2", "cam_3"]


def test_anipose_with_the_first_cameras_frame_in_millimetres(rig: CameraRig, tmp_path: Path) -> None:
    first = rig.cameras[0]
    tables = {}
    for i, camera in enumerate(rig.cameras):
        rotation = camera.rotation @ first.rotation.T
        tables[f"cam_{i}"] = {
            "name": camera.name,
            "size": list(camera.image_size),
            "matrix": camera.matrix,
            "distortions": LENS,
            "rotation": rot.to_rotation_vector(rot.from_matrix(rotation)),
            "translation": 1000.0 * (camera.translation_m - rotation @ first.translation_m),
        }
    write_toml(tmp_path / "calibration.toml", tables | {"metadata": {"adjusted": False, "error": 0.4}})
    read = load_rig(tmp_path / "calibration.toml")
    assert read.baseline_m() == pytest.approx(rig.baseline_m(), rel=1e-9)
    np.testing.assert_allclose(read.cameras[0].rotation, np.diag([1.0, -1.0, -1.0]), atol=1e-9)  # y up


def test_a_world_that_is_upright_or_in_which_the_cameras_do_not_agree_stays(rig: CameraRig) -> None:
    upright = np.stack([camera.rotation for camera in rig.cameras])
    apart = np.stack([upright[0] @ np.roll(np.eye(3), shift, axis=0) for shift in range(3)])
    for rotations in (upright, apart):
        np.testing.assert_array_equal(level_from_world(rotations), np.eye(3))


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_axis_along_which_the_cameras_are_upright_becomes_y(rig: CameraRig, axis: int, sign: float) -> None:
    up = sign * np.eye(3)[axis]
    from_ours = rot.to_matrix(rot.between([0.0, 1.0, 0.0], up))
    turn = level_from_world(np.stack([camera.rotation @ from_ours.T for camera in rig.cameras]))
    np.testing.assert_allclose(turn @ up, [0.0, 1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(turn) == pytest.approx(1.0)


def test_a_published_qualisys_file(shared_dir: Path) -> None:
    read = load_rig(shared_dir / "calibration" / "pose2sim_qualisys" / "Calib.qca.txt")
    assert [camera.image_size for camera in read.cameras] == [(1088, 1920)] * 4
    # the cameras stand round a person: their axes meet before all of them, above the floor and below the cameras
    across = [np.eye(3) - np.outer(c.rotation[2], c.rotation[2]) for c in read.cameras]
    middle = np.linalg.solve(sum(across), sum(a @ c.centre_m for a, c in zip(across, read.cameras, strict=True)))
    for camera in read.cameras:
        pixel = camera.project(middle)
        assert ((pixel > 0) & (pixel < camera.image_size)).all()
        assert 0.0 < middle[1] < camera.centre_m[1]
        assert 1.5 < camera.centre_m[1] < 2.5


@pytest.mark.parametrize(
    ("folder", "name", "cameras"),
    [
        ("caliscope/sessions/charuco_calibration", "camera_array.toml", 4),
        ("caliscope/sessions/charuco_calibration", "config.toml", 4),
        ("caliscope/sessions/larger_calibration_post_monocal", "camera_array.toml", 11),
        ("anipose_AmbiguousMonkey/ammonkey/cfgs", "calibration.toml", 4),
        ("anipose_Markerless-Tracking-GUI", "calibration.toml", 3),
    ],
)
def test_published_files(shared_dir: Path, folder: str, name: str, cameras: int) -> None:
    read = load_rig(shared_dir / "calibration" / folder / name)
    assert len(read) == cameras
    distances = [read.baseline_m(0, i) for i in range(1, cameras)]
    assert min(distances) > 0.1 and max(distances) < 10.0  # metres, whatever the file has


def test_published_file_without_poses_is_refused(shared_dir: Path) -> None:
    folder = shared_dir / "calibration" / "caliscope" / "sessions" / "not_sufficient_stereopairs"
    with pytest.raises(PerfanimError, match="has no rotation"):
        load_rig(folder / "camera_array.toml")
