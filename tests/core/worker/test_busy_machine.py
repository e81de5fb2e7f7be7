"""Slow is not dead: captures on a machine with four times as much to do as it can."""

import time
from pathlib import Path
from typing import Any

import cv2
import pytest
from busy import busy_machine
from motion_synthesis import perform
from perfanim.core.database.build_database import BuildSettings, build_database
from perfanim.core.formats.motion.bvh import write_bvh
from perfanim.core.formats.take_file.take_reader import read_take_file
from perfanim.core.geometry.rig_file import rig_tables
from perfanim.core.markers.subject import subject_tables
from perfanim.core.simulate.studio.simulated_source import open_simulated
from perfanim.core.worker.client import WorkerClient
from perfanim.perfanim_addon.capture.capture_run import CaptureRun, Phase

PATIENCE_S = 300.0
BUSY_S = 10.0
FRAMES = 100
PERFORMER = {"kind": "simulated", "behaviour": "walking", "seconds": 2.0}


@pytest.fixture(scope="module")
def request_files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    folder = tmp_path_factory.mktemp("busy")
    write_bvh(perform("walking", 4.0), folder / "walk.bvh")
    build_database([str(folder / "walk.bvh")], folder / "walk.pfdb", BuildSettings(fps=60.0))
    performers = [subject_tables(open_simulated(PERFORMER).subject)]
    return {"performers": performers, "database": str(folder / "walk.pfdb")}


def capture(request: dict[str, Any], frames: int) -> tuple[CaptureRun, list[str]]:
    """Capture so many frames, most of them on a busy machine; return the run, and what the panel said."""
    run, said = CaptureRun(WorkerClient(request)), []
    limit_s = time.monotonic() + PATIENCE_S

    def advance() -> None:
        assert time.monotonic() < limit_s, run.notices
        if run.tick() is not None:
            run.shown()
        said.extend(run.notices)  # the panel shows all; the busy machine's comes after those of the pose
        time.sleep(1 / 60)  # as Blender's timer

    try:
        while len(run.poses) < 10 and run.phase is not Phase.DONE:
            advance()
        with busy_machine(BUSY_S):
            while run.phase is not Phase.DONE:
                if len(run.poses) >= frames:
                    run.stop()
                advance()
    finally:
        run.close()
    return run, said


def check(run: CaptureRun, said: list[str], path: Path) -> None:
    assert run.error is None
    assert not [text for text in [*run.warnings, *said] if "restarting" in text]
    assert any(text.startswith("this computer is busy: work takes ") for text in said)
    take = read_take_file(path)
    assert take.complete
    assert take.gaps == ()
    assert [frame.number for frame in take.frames] == list(range(len(run.poses)))
    assert [solved.pose.number for solved in take.poses] == [pose.number for pose in run.poses]


@pytest.mark.long
def test_recorded_images_lose_no_frame_on_a_busy_machine(request_files: dict[str, Any], tmp_path: Path) -> None:
    source = open_simulated(PERFORMER)
    for images in source:
        for camera, image in zip(("left", "right"), images.images, strict=True):
            (tmp_path / camera).mkdir(exist_ok=True)
            cv2.imwrite(str(tmp_path / camera / f"{images.number:04d}.png"), image)
        if images.number == FRAMES - 1:
            break
    recorded = {"kind": "images", "paths": [str(tmp_path / "left"), str(tmp_path / "right")], "fps": 60.0}
    cameras = {"source": recorded, "rig": rig_tables(source.rig), "threshold": None}
    path = tmp_path / "images.perftake"
    asked = {"job": "capture", "cameras": cameras, **request_files, "take": str(path)}
    run, said = capture(asked, FRAMES + 1)
    check(run, said, path)
    assert len(run.poses) == FRAMES == run.statistics.handed_over


@pytest.mark.long
def test_the_simulated_performer_goes_on_on_a_busy_machine(request_files: dict[str, Any], tmp_path: Path) -> None:
    path = tmp_path / "simulated.perftake"
    cameras = {"source": {**PERFORMER, "loop": True}, "rig": None, "threshold": None}
    asked = {"job": "capture", "cameras": cameras, **request_files, "take": str(path)}
    check(*capture(asked, FRAMES), path)
