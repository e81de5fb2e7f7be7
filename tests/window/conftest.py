"""Fixtures: a real Blender with the extension installed as a user does, on a screen of its own."""

import os
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))  # the tests share desktop.py

from desktop import ROOT, BlenderWindow, Desktop, build_archive, install


@pytest.fixture(scope="session")
def wrapper() -> str:
    """Program that runs its arguments where Blender is."""
    wrapper = os.environ.get("BLENDER", "")
    if not wrapper:
        pytest.skip("the environment variable BLENDER names no Blender with a window")
    return wrapper


@pytest.fixture(scope="session")
def user(wrapper: str, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Blender's user folder with the extension's archive, built for this Blender's Python, installed in it."""
    user = tmp_path_factory.mktemp("blender-user")
    install(wrapper, build_archive(), user)
    return user


@pytest.fixture
def desktop(wrapper: str) -> Iterator[Desktop]:
    """An empty screen; pictures of it are kept under out/window."""
    desktop = Desktop(wrapper, ROOT / "out" / "window")
    yield desktop
    desktop.close()


@pytest.fixture
def window(desktop: Desktop, user: Path, tmp_path: Path) -> Iterator[BlenderWindow]:
    """A freshly started Blender."""
    window = BlenderWindow(desktop, user, tmp_path / "observer")
    yield window
    window.close()


@pytest.fixture
def calibration(tmp_path: Path) -> Path:
    """A valid calibration."""
    from perfanim.core.geometry.rig_file import save_rig
    from perfanim.core.simulate.studio.studio_rig import default_rig

    path = tmp_path / "cameras.toml"
    save_rig(default_rig(), path)
    return path


@pytest.fixture
def subject(tmp_path: Path) -> Path:
    """A valid subject."""
    from perfanim.core.body.standard_skeleton import default_skeleton
    from perfanim.core.markers.marker_set import load_marker_set
    from perfanim.core.markers.subject import Subject, save_subject

    path = tmp_path / "subject.toml"
    save_subject(Subject("Anna", default_skeleton(), load_marker_set("boxing"), 0.006), path)
    return path


@pytest.fixture(scope="session")
def board(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Settings for folders of both cameras with pictures of a board of 9x6 corners."""
    from perfanim.core.simulate.studio.render import Renderer
    from perfanim.core.simulate.studio.studio_rig import default_rig
    from recordings import record_board

    folder = tmp_path_factory.mktemp("board")
    record_board(folder, Renderer(default_rig()), count=6)
    return {"board_left": str(folder / "left"), "board_right": str(folder / "right")}


@pytest.fixture(scope="session")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Settings for image folders of both cameras, 180 moments at 60 Hz, with calibration and subject."""
    from perfanim.core.geometry.rig_file import save_rig
    from perfanim.core.markers.subject import save_subject
    from recordings import record_walk

    folder = tmp_path_factory.mktemp("recorded")
    source = record_walk(folder, 4.0, range(180, 360))
    save_rig(source.rig, folder / "cameras.toml")
    save_subject(source.subject, folder / "subject.toml")
    return {
        "source": "IMAGES",
        "left_folder": str(folder / "left"),
        "right_folder": str(folder / "right"),
        "calibration": str(folder / "cameras.toml"),
        "subject": str(folder / "subject.toml"),
    }
