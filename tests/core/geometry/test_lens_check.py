from pathlib import Path

import numpy as np
import pytest
from perfanim.core.errors import CalibrationError
from perfanim.core.geometry.camera import Camera, CameraRig
from perfanim.core.geometry.lens_check import lens_fault
from perfanim.core.geometry.rig_file import load_rig, save_rig


def camera(fx: float, fy: float, centre: tuple[float, float] = (320.0, 240.0), k1: float = 0.0) -> Camera:
    matrix = np.array([[fx, 0.0, centre[0]], [0.0, fy, centre[1]], [0.0, 0.0, 1.0]])
    return Camera("b", (640, 480), matrix, np.array([k1]))


@pytest.mark.parametrize(
    ("lens", "fault"),
    [
        (camera(600.0, 602.0, k1=-0.4), ""),
        (camera(240.0, 240.0, k1=-0.1), ""),
        (camera(20000.0, 20000.0), ""),
        (camera(28.0, 28.0, k1=0.9), "field of view of 170 degrees"),
        (camera(1e6, 1e6), "field of view of 0.0367 degrees"),
        (camera(600.0, 200.0), "focal lengths 600 and 200 pixels"),
        (camera(600.0, 600.0, (3000.0, 240.0)), "far outside the image"),
        (camera(300.0, 300.0, k1=-8.0), "folds the image"),
    ],
)
def test_lenses_that_cannot_be_are_told(lens: Camera, fault: str) -> None:
    found = lens_fault(lens)
    assert fault in found and bool(fault) == bool(found)


def test_a_calibration_with_such_a_lens_is_refused(tmp_path: Path) -> None:
    save_rig(CameraRig((camera(28.0, 28.0),)), tmp_path / "rig.toml")
    with pytest.raises(
        CalibrationError, match=r"rig.toml: camera b has a field of view of 170 degrees.*; calibrate it"
    ):
        load_rig(tmp_path / "rig.toml")
