"""Floor and scale from markers lying on the floor, as the sidebar and as the command line have it."""

import json
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest
from perfanim.core.cli.main import main
from perfanim.core.errors import CalibrationError
from perfanim.core.geometry.camera import Camera, CameraRig
from perfanim.core.geometry.rig_file import load_rig, rig_from, save_rig
from perfanim.core.simulate.studio.floor_marker_source import PLACES_M, SETTINGS, FloorMarkers
from perfanim.core.simulate.studio.simulated_performer import SimulatedPerformer
from perfanim.core.simulate.studio.studio_rig import default_rig
from perfanim.core.vision.sources.image_set import ImageSet
from perfanim.core.worker.jobs import record_floor_markers
from perfanim.core.worker.requests import FloorMarkersRequest

# Centres known to 0.05 px are 1 mm off in depth; over four of them on 1 m x 0.6 m the floor tilts by 1.7 mrad, which is
# 6 mm at the cameras; five times that.
TOLERANCE_M = 0.03
SHIFT_M = np.array([0.3, -0.2, 0.1])
FACTOR = 1.1
LONGEST_M = float(np.linalg.norm(PLACES_M[:, None] - PLACES_M, axis=2).max())


@pytest.fixture
def elsewhere() -> CameraRig:
    """The cameras in another world, a tenth too large."""
    cameras = [
        Camera(c.name, c.image_size, c.matrix, c.distortion, c.rotation,
               FACTOR * (c.translation_m + c.rotation @ SHIFT_M)) for c in default_rig().cameras
    ]  # fmt: skip
    return CameraRig(tuple(cameras))


def check(found: CameraRig) -> None:
    assert found.metadata["floor"] == "y = 0"
    for camera, other in zip(found.cameras, default_rig().cameras, strict=True):
        expected = other.centre_m - np.insert(PLACES_M.mean(axis=0), 1, 0.0)
        # the new z axis points from the markers' middle to between the cameras
        turned = expected - np.array([0.0, expected[1], 0.0])
        assert camera.centre_m[1] == pytest.approx(expected[1], abs=TOLERANCE_M)
        assert np.hypot(*camera.centre_m[[0, 2]]) == pytest.approx(np.linalg.norm(turned), abs=TOLERANCE_M)


def channel_into(results: list[dict[str, Any]], told: list[str]) -> Any:
    return SimpleNamespace(
        stop_requested=threading.Event(),
        send_status=lambda text, *_: told.append(text),
        send_result=results.append,
        send_preview=lambda picture: told.append("picture"),
    )


def test_floor_and_scale_are_found_in_the_sidebar(elsewhere: CameraRig) -> None:
    results: list[dict[str, Any]] = []
    told: list[str] = []
    request = FloorMarkersRequest(
        source=SimulatedPerformer(), rig=elsewhere, preview=True, height_m=SETTINGS.marker_radius_m, longest_m=LONGEST_M
    )
    record_floor_markers.run(request, channel_into(results, told))
    (result,) = results
    assert result["markers"] == len(PLACES_M)
    assert result["scale"] == pytest.approx(1.0 / FACTOR, rel=0.005)  # 5 mm of 1.2 m
    check(rig_from(result["rig"], "result"))
    assert "let them lie still" in told
    assert "picture" in told


def test_without_markers_it_says_what_to_do(elsewhere: CameraRig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(FloorMarkers, "__iter__", lambda self: iter(empty_room(self)))
    results: list[dict[str, Any]] = []
    with pytest.raises(CalibrationError, match="lay 3 or more markers on the floor"):
        request = FloorMarkersRequest(source=SimulatedPerformer(), rig=elsewhere)
        record_floor_markers.run(request, channel_into(results, []))
    assert not results


def empty_room(source: FloorMarkers) -> Any:
    for number, images in enumerate(source.background_frames(5)):
        yield ImageSet(number, (number / 5.0,) * 2, images)


def test_floor_and_scale_are_found_on_the_command_line(
    elsewhere: CameraRig, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = FloorMarkers(default_rig())
    kinds = {"room": list(source.background_frames(8)), "floor": [frame.images for frame in source][:75]}
    for name, moments in kinds.items():
        for side in (0, 1):
            path = tmp_path / f"{name}{side}.avi"
            writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), source.fps, (640, 480))
            for images in moments:
                writer.write(images[side])
            writer.release()
    save_rig(elsewhere, tmp_path / "rig.toml")
    arguments = ["calibrate", "floor", "--cameras", str(tmp_path / "rig.toml"), "--out", str(tmp_path / "level.toml")]
    arguments += ["--height-mm", str(1e3 * SETTINGS.marker_radius_m), "--longest-mm", str(1e3 * LONGEST_M), "--json"]
    arguments += ["--left", str(tmp_path / "floor0.avi"), "--right", str(tmp_path / "floor1.avi")]
    arguments += ["--background", str(tmp_path / "room0.avi"), str(tmp_path / "room1.avi")]
    assert main(arguments) == 0
    summary = json.loads(capsys.readouterr().out)
    assert summary["markers"] == len(PLACES_M)
    assert summary["scale"] == pytest.approx(1.0 / FACTOR, rel=0.005)
    check(load_rig(tmp_path / "level.toml"))

    (tmp_path / "level.toml").unlink()
    assert main([*arguments[:-1], str(tmp_path / "room1.avi"), "--longest-mm", "-5"]) == 1
    assert "markers cannot be" in capsys.readouterr().err
    assert not (tmp_path / "level.toml").exists()
