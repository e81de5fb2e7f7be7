import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from perfanim.core.cli.main import main
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.camera import WORLD_FROM_CAMERA, Camera, CameraRig
from perfanim.core.geometry.rig_file import load_rig, save_rig

SIZE = (640, 480)
FRAMES = 60


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Images of five moving markers, the cameras' calibration, and one of before the right camera was turned."""
    tmp_path = tmp_path_factory.mktemp("refine")
    matrix = np.array([[600.0, 0.0, 320.0], [0.0, 600.0, 240.0], [0.0, 0.0, 1.0]])
    cameras = []
    for name, x_m, toe_in in (("left", -0.5, -0.15), ("right", 0.5, 0.15)):
        rotation = rot.to_matrix(rot.from_rotation_vector(np.array([0.0, toe_in, 0.0]))) @ WORLD_FROM_CAMERA
        cameras.append(
            Camera(name, SIZE, matrix, rotation=rotation, translation_m=-rotation @ np.array([x_m, 0.0, 0.0]))
        )
    rng = np.random.default_rng(0)
    for camera in cameras:
        (tmp_path / camera.name).mkdir()
    for number in range(FRAMES):
        points = rng.uniform([-0.5, -0.5, -2.9], [0.5, 0.5, -2.0], (5, 3))
        for camera in cameras:
            picture = rng.integers(5, 12, (SIZE[1], SIZE[0], 3), dtype=np.uint8)
            for pixel in camera.project(points):
                cv2.circle(picture, tuple(int(v) for v in np.round(pixel * 16)), 80, (230,) * 3, -1, cv2.LINE_AA, 4)
            cv2.imwrite(str(tmp_path / camera.name / f"{number:03d}.png"), picture)
    save_rig(CameraRig(tuple(cameras)), tmp_path / "now.toml")
    turn = rot.to_matrix(rot.from_rotation_vector(np.radians([1.0, -0.5, 0.5])))
    rotation = turn @ cameras[1].rotation
    before = replace(cameras[1], rotation=rotation, translation_m=-rotation @ cameras[1].centre_m)
    save_rig(CameraRig((cameras[0], before)), tmp_path / "before.toml")
    return tmp_path


def refine(folder: Path, cameras: str, capsys: pytest.CaptureFixture[str]) -> dict:
    sources = ["--left", f"{folder}/left", "--right", f"{folder}/right"]
    arguments = ["calibrate", "refine", "--cameras", f"{folder}/{cameras}", *sources]
    assert main([*arguments, "--out", f"{folder}/refined.toml", "--json"]) == 0
    return json.loads(capsys.readouterr().out)


@pytest.mark.long
def test_a_bumped_camera_is_told_and_placed_anew(folder, capsys):
    summary = refine(folder, "before.toml", capsys)
    assert summary["bumped"] and summary["changed"] and "right has moved" in summary["advice"][0]
    assert summary["turned_deg"]["right"] == pytest.approx(np.sqrt(1.0 + 0.25 + 0.25), abs=0.2)
    found, truth = load_rig(folder / "refined.toml").cameras[1], load_rig(folder / "now.toml").cameras[1]
    assert np.degrees(np.arccos((np.trace(found.rotation @ truth.rotation.T) - 1.0) / 2.0)) < 0.2
    np.testing.assert_allclose(found.centre_m, truth.centre_m, atol=0.01)


def test_pictures_of_another_calibration_are_one_line(folder, capsys):
    rig = load_rig(folder / "now.toml")
    other = [replace(camera, image_size=(320, 240)) for camera in rig.cameras]
    save_rig(CameraRig(tuple(other)), folder / "other.toml")
    arguments = ["calibrate", "refine", "--cameras", f"{folder}/other.toml", "--left", f"{folder}/left"]
    assert main([*arguments, "--right", f"{folder}/right", "--out", f"{folder}/none.toml"]) == 1
    shown = capsys.readouterr()
    assert "use the calibration of these cameras" in shown.err and shown.err.count("\n") == 1
    assert not (folder / "none.toml").exists()
