"""Pictures of both cameras in one folder are told apart by patterns of their names."""

from dataclasses import asdict
from typing import Any

import bpy
import cv2
import numpy as np
import pytest
from perfanim.core.worker.open_source import open_source


@pytest.fixture
def chosen() -> Any:
    settings = bpy.context.scene.perfanim
    settings.source = "IMAGES"
    return settings


def test_patterns_tell_the_cameras_of_one_folder_apart(part: Any, chosen: Any, tmp_path: Any) -> None:
    for number in range(3):
        for camera in (1, 2):
            cv2.imwrite(str(tmp_path / f"{number}_{camera}.png"), np.full((48, 64), 100 * camera, np.uint8))
    chosen.left_folder, chosen.right_folder = str(tmp_path / "*_1.png"), str(tmp_path / "*_2.png")
    assert part("settings.readiness").pictures(chosen).ready
    source = open_source(asdict(part("capture.capture_request").source(chosen)))
    levels = [[int(image.max()) for image in moment.images] for moment in source]
    assert levels == [[100, 200]] * 3


def test_a_pattern_in_a_folder_that_is_not_there_is_refused(part: Any, chosen: Any, tmp_path: Any) -> None:
    chosen.left_folder = chosen.right_folder = str(tmp_path / "none" / "*_1.png")
    assert part("settings.readiness").pictures(chosen).text == "left not found"
    error = part("capture.capture_request").CaptureError  # the installed copy's
    with pytest.raises(error, match="not found; choose another under Cameras"):
        part("capture.capture_request").source(chosen)
