"""A walk and what its takes need."""

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from perfanim.core.body.motion import resampled
from perfanim.core.cli.main import main
from perfanim.core.formats.motion.bvh import write_bvh
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.subject import Subject, save_subject
from perfanim.core.system.assets import MOTION


@pytest.fixture(scope="session")
def walk(tmp_path_factory: pytest.TempPathFactory) -> SimpleNamespace:
    """Anna, her walk (30 frames a second), and a folder with both and a database of the walk."""
    folder = tmp_path_factory.mktemp("walk")
    motion = resampled(read_motion(MOTION / "walking-01-neutral.bvh"), 30.0)
    write_bvh(motion, folder / "walk.bvh")
    assert main(["database", "build", str(folder / "walk.bvh"), "--fps", "30", "--out", str(folder / "walk.pfdb")]) == 0
    subject = Subject("Anna", motion.skeleton, load_marker_set("locomotion"))
    save_subject(subject, folder / "anna.toml")
    return SimpleNamespace(folder=folder, motion=motion, subject=subject)


@pytest.fixture
def anna(chosen: Any, walk: SimpleNamespace) -> Path:
    """The file of Anna, who is chosen with her database."""
    chosen.subject, chosen.database = str(walk.folder / "anna.toml"), str(walk.folder / "walk.pfdb")
    chosen.marker_set = "locomotion"
    return Path(chosen.subject)


@pytest.fixture
def message(part: Callable[[str], Any]) -> Callable[[str], str]:
    """Return the message of a panel."""
    return lambda panel: str(part("jobs.activity").message(panel)[0])
