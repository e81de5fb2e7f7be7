"""Fixtures shared by all tests: where the recordings of others lie, if they are there."""

import fcntl
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
LONGEST = ("test_demo.py", "test_cmu.py", "test_capture_chain.py", "test_recorded_boards.py", "test_jobs.py",
           "test_single_view_start.py", "test_bad_input.py", "test_two_webcams_chain.py",
           "test_live_capture.py")  # fmt: skip


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
    items.sort(key=lambda item: LONGEST.index(item.path.name) if item.path.name in LONGEST else len(LONGEST))


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport(item: pytest.Item) -> Generator[None, pytest.CallInfo, None]:
    """With PERFANIM_NO_SKIP set, what would be skipped fails: where everything is present, everything must run."""
    outcome = yield
    report = outcome.get_result()
    if report.skipped and os.environ.get("PERFANIM_NO_SKIP"):
        reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
        report.outcome = "failed"
        report.longrepr = f"{item.nodeid} was skipped, but PERFANIM_NO_SKIP is set: {reason}"
