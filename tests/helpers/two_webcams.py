"""The cameras of the public recording by two webcams, as its authors calibrated them."""

import json
from pathlib import Path

import numpy as np
from perfanim.core.geometry.camera import WORLD_FROM_CAMERA, Camera, CameraRig


def published_rig(folder: Path) -> CameraRig:
    """Return the rig without a floor: the world's axes are the left camera's, half a turn about x."""
    kept = json.loads((folder / "stereo_calibration.json").read_text())
    cameras = []
    for name, number, turn, shift_mm in (
        ("left", 1, np.eye(3), np.zeros(3)),
        ("right", 2, np.array(kept["R"]), np.array(kept["T_mm"])),
    ):
        matrix, lens = np.array(kept[f"K{number}"]), np.array(kept[f"dist{number}"])
        cameras.append(
            Camera(name, tuple(kept["image_size"]), matrix, lens, turn @ WORLD_FROM_CAMERA, 0.001 * shift_mm)
        )
    return CameraRig(tuple(cameras))
