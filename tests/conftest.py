"""Fixtures shared by all tests: where the recordings of others lie, if they are there."""

import os
import subprocess
import sys
import tempfile
from collections.abc import Generator
from pathlib import Path

import pytest

sys.path[:0] = [str(Path(__file__).parent / "helpers"), str(Path(__file__).parents[1] / "tools")]

ROOT = Path(__file__).resolve().parent.parent
SHARED = ROOT.parent / "shared"
# The longest files, which begin first: one that began last would leave the other processes with nothing to do.
LONGEST = (
    "window/test_first_hour.py",
    "window/test_walkthrough.py",
    "window/test_capture.py",
    "setup_check/test_setup_check.py",
    "bench/test_command.py",
    "simulate/test_demo.py",
    "jobs/test_check_setup.py",
    "subjects/test_suit_recognition.py",
    "capture/test_live_capture.py",
    "cli/test_foreign_marker_files.py",
    "worker/test_capture_chain.py",
    "operators/test_image_pairs.py",
    "take/test_irregular_takes.py",
    "session/test_poison.py",
    "character/test_retarget.py",
    "calibration/test_recorded_boards.py",
    "subjects/test_from_motion.py",
    "cli/test_track_body.py",
    "setup_check/test_recorded_webcams.py",
    "session/test_session_recovery.py",
    "settings/test_guide_steps.py",
    "cli/test_check_command.py",
    "vision/test_two_webcams.py",
    "calibration/test_calibrate.py",
    "simulate/test_studio_recordings.py",
    "operators/test_jobs.py",
    "jobs/test_record_board.py",
    "labelling/test_take_import.py",
    "markers/test_gap_filling.py",
    "sketch/test_live.py",
    "export/test_retarget_file.py",
    "sketch/test_solve_sketch.py",
    "capture/test_performers.py",
    "take/test_import_takes.py",
    "sketch/test_sketch.py",
    "fuzz/test_damaged_inputs.py",
    "tools/test_sketch_sample.py",
    "take/test_export_take.py",
)


@pytest.fixture(scope="session")
def shared_dir() -> Path:
    """Folder of test data written by others."""
    data = SHARED / "data"
    if not data.is_dir():
        pytest.skip("../shared/data is not here")
    return data


@pytest.fixture(scope="session")
def mocap_dir() -> Path:
    """Folder with the unpacked motion archives (cmu, bandai)."""
    tool = SHARED / "tools" / "unpack-data"
    if not tool.is_file():
        pytest.skip("../shared/tools/unpack-data is not here")
    import fcntl  # not on Windows, and the tool is not either

    with (Path(tempfile.gettempdir()) / "perfanim-unpack.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)  # tests run in several processes: one of them unpacks
        done = subprocess.run([str(tool)], check=True, capture_output=True, text=True)
    return Path(done.stdout.strip().splitlines()[-1])


@pytest.fixture(scope="session")
def cmu_dir(mocap_dir: Path) -> Path:
    """Unpacked CMU trials."""
    return mocap_dir / "cmu"


@pytest.fixture(scope="session")
def bandai_dir(mocap_dir: Path) -> Path:
    """Unpacked BVH clips."""
    return mocap_dir / "bandai"


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers() -> int:
    """One process more than there are cores: many tests wait for others that they have started."""
    return (os.cpu_count() or 1) + 1


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the longest files first; `--no-loadscope-reorder` keeps this order."""
    places = {file: place for place, file in enumerate(LONGEST)}
    items.sort(key=lambda item: places.get("/".join(item.path.parts[-2:]), len(LONGEST)))


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.CallInfo, None]:
    """With PERFANIM_NO_SKIP set, what would be skipped fails: where everything is present, everything must run."""
    outcome = yield
    report = outcome.get_result()
    if report.skipped and os.environ.get("PERFANIM_NO_SKIP"):
        reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
        report.outcome = "failed"
        report.longrepr = f"{item.nodeid} was skipped, but PERFANIM_NO_SKIP is set: {reason}"
