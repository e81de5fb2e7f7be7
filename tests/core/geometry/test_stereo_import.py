"""Stereo calibrations in the forms of OpenCV and MATLAB, written here from known cameras."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from perfanim.core.errors import CalibrationError
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.camera import Camera
from perfanim.core.geometry.rig_file import load_rig
from scipy.io import savemat

LENSES = [np.array([-0.2, 0.05, 0.001, -0.002, 0.01]), np.array([-0.1, 0.02, -0.003, 0.001, 0.004])]
MATRICES = [
    np.array([[900.0, 1.5, 650.0], [0.0, 910.0, 350.0], [0.0, 0.0, 1.0]]),
    np.array([[890.0, -0.5, 630.0], [0.0, 880.0, 370.0], [0.0, 0.0, 1.0]]),
]
TURN = rot.to_matrix(rot.from_rotation_vector([0.05, -0.4, 0.02]))
PIXEL_ONE = np.array([[0, 0, 1], [0, 0, 1], [0, 0, 0]])
SHIFT_MM = np.array([-700.0, 12.0, 90.0])
PLAIN = {
    "K1": MATRICES[0], "D1": LENSES[0], "K2": MATRICES[1], "D2": LENSES[1], "R": TURN, "T": SHIFT_MM.reshape(3, 1),
}  # fmt: skip


def check(cameras: tuple[Camera, ...], size: tuple[int, int] = (1280, 720)) -> None:
    for camera, matrix, lens in zip(cameras, MATRICES, LENSES, strict=True):
        np.testing.assert_allclose(camera.matrix, matrix, atol=1e-9)
        np.testing.assert_allclose(camera.distortion, lens, atol=1e-12)
        assert camera.image_size == size
    first, second = cameras
    np.testing.assert_allclose(second.rotation @ first.rotation.T, TURN, atol=1e-9)
    point = np.array([0.3, 0.2, 2.0])
    seen = [camera.rotation @ point + camera.translation_m for camera in cameras]
    np.testing.assert_allclose(seen[1], TURN @ seen[0] + SHIFT_MM / 1000.0, atol=1e-9)
    assert first.rotation[1, 1] == -1.0  # y is up


def by_opencv(path: Path) -> None:
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for name, value in PLAIN.items():
        storage.write(name, value)
    storage.write("image_size", np.array([1280, 720]))
    storage.release()


def nested_lists(path: Path) -> None:
    """As Python scripts write it, in block style."""
    lines = ["image_width: 1280", "image_height: 720"]
    for name, value in {"mtx_left": MATRICES[0], "mtx_right": MATRICES[1], "rotation_matrix": TURN}.items():
        lines += [f"{name}:", *(f"{'-' if n % 3 == 0 else ' '} - {v!r}" for n, v in enumerate(value.ravel().tolist()))]
    for name, row in {"dist_left": LENSES[0], "dist_right": LENSES[1], "translation": SHIFT_MM}.items():
        lines += [f"{name}: {row.tolist()}"]
    path.write_text("\n".join(lines) + "\n")


def plain_json(path: Path) -> None:
    rows = {name: np.asarray(value).tolist() for name, value in PLAIN.items()}
    path.write_text(json.dumps({"made by": "a script", "rms": 0.3, "imageSize": [1280, 720], **rows}))


def matlab_structure() -> dict[str, Any]:
    """As toStruct(stereoParams): matrices for row vectors, pixels from 1, height before width."""
    numbered = {
        f"CameraParameters{n + 1}": {
            "IntrinsicMatrix": (matrix + PIXEL_ONE).T,
            "RadialDistortion": lens[[0, 1, 4]],
            "TangentialDistortion": lens[2:4],
            "ImageSize": np.array([720.0, 1280.0]),
            "WorldUnits": "millimeters",
        }
        for n, (matrix, lens) in enumerate(zip(MATRICES, LENSES, strict=True))
    }
    return {**numbered, "RotationOfCamera2": TURN.T, "TranslationOfCamera2": SHIFT_MM, "Version": {"Major": 1}}


def matlab_mat(path: Path) -> None:
    savemat(path, {"stereoParams": matlab_structure()})


def matlab_json(path: Path) -> None:
    path.write_text(json.dumps(matlab_structure(), default=np.ndarray.tolist))


def matlab_for_opencv(path: Path) -> None:
    names = ("intrinsicMatrix1", "distortionCoefficients1", "intrinsicMatrix2", "distortionCoefficients2",
             "rotationOfCamera2", "translationOfCamera2")  # fmt: skip
    savemat(path, dict(zip(names, PLAIN.values(), strict=True)) | {"imageSize": [[720, 1280]]})


def bouguet(path: Path) -> None:
    values: dict[str, Any] = {"R": TURN, "T": SHIFT_MM, "om": np.zeros(3), "nx": 1280, "ny": 720}
    for side, matrix, lens in zip(("left", "right"), MATRICES, LENSES, strict=True):
        values |= {f"fc_{side}": matrix[[0, 1], [0, 1]], f"cc_{side}": matrix[:2, 2], f"kc_{side}": lens}
        values[f"alpha_c_{side}"] = matrix[0, 1] / matrix[0, 0]
    savemat(path, values)


@pytest.mark.parametrize(
    ("name", "write"),
    [
        ("opencv.yml", by_opencv), ("opencv.xml", by_opencv), ("opencv.json", by_opencv), ("script.yaml", nested_lists),
        ("script.json", plain_json), ("stereoParams.mat", matlab_mat), ("stereoParams.json", matlab_json),
        ("for-opencv.mat", matlab_for_opencv), ("Calib_Results_stereo.mat", bouguet),
    ],
)  # fmt: skip
def test_stereo_files_are_read(tmp_path: Path, name: str, write: Callable[[Path], None]) -> None:
    write(tmp_path / name)
    check(load_rig(tmp_path / name).cameras)


def test_a_file_without_the_size_of_the_images_gets_a_usual_one(tmp_path: Path) -> None:
    rows = {name: np.asarray(value).tolist() for name, value in PLAIN.items()}
    (tmp_path / "a.json").write_text(json.dumps(rows))
    check(load_rig(tmp_path / "a.json").cameras)
    rows["K1"][0][2] = 100.0
    (tmp_path / "a.json").write_text(json.dumps(rows))
    with pytest.raises(CalibrationError, match="does not state the size of the images"):
        load_rig(tmp_path / "a.json")


def test_translations_in_metres_stay(tmp_path: Path) -> None:
    rows = {name: np.asarray(value).tolist() for name, value in PLAIN.items()} | {"T": (SHIFT_MM / 1000.0).tolist()}
    (tmp_path / "a.json").write_text(json.dumps(rows))
    check(load_rig(tmp_path / "a.json").cameras)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (b'{"K1": [[1, 2, 3], [4, 5, 6], [7, 8, 9]]}', "holds no two camera matrices"),
        (b'{"K1": [[1', "not a readable calibration"),
        (b"MATLAB 7.3 MAT-file", "version 7.3"),
        (b"MATLAB 5.0 MAT-file", "not a readable calibration"),
        (b"%YAML:1.0\nK1: 3\n", "holds no two camera matrices"),
        (b"<?xml version='1.0'?><opencv_storage><K1>", "not a readable calibration"),
    ],
)
def test_other_content_is_refused(tmp_path: Path, text: bytes, message: str) -> None:
    (tmp_path / "a.json").write_bytes(text)
    with pytest.raises(CalibrationError, match=message):
        load_rig(tmp_path / "a.json")


def test_one_camera_alone_is_no_stereo_calibration(tmp_path: Path) -> None:
    rows = {name: np.asarray(value).tolist() for name, value in PLAIN.items() if name not in "RT"}
    (tmp_path / "a.json").write_text(json.dumps(rows))
    with pytest.raises(CalibrationError, match="does not say where the second camera is"):
        load_rig(tmp_path / "a.json")


def test_a_published_file_has_its_cameras_apart(shared_dir: Path) -> None:
    rig = load_rig(shared_dir / "two-webcams" / "stereo_calibration.json")
    assert rig.baseline_m(0, 1) == pytest.approx(0.3657, abs=1e-4)  # by the length of its T_mm
    assert rig.cameras[0].image_size == (640, 480)
