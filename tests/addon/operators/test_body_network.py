"""The body network in Blender: brought from a file or with pip, and what is said without it."""

from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import pytest
from clicked import run_job
from measured_layout import Layout
from perfanim.core.vision.people.network_file import NETWORK_FILE, body_network_file

pytestmark = pytest.mark.usefixtures("near_worker")
MISSING = "the body network is not there yet: click Get Body Network under Cameras, or open its file"


@pytest.fixture
def own_cache(part: Any, extension: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """The file of the network, in a folder that is empty at first."""
    module = import_module(f"{extension}.core.vision.people.network_file")
    monkeypatch.setattr(module, "cache_folder", lambda: tmp_path / "cache")
    return tmp_path / "cache" / "networks" / NETWORK_FILE


def clicked(part: Any, name: str, **given: Any) -> str:
    return run_job(part, getattr(part("operators.body_network_operators"), name), SimpleNamespace(**given))


def opened(part: Any, path: Path) -> str:
    files = [SimpleNamespace(name=path.name)] if path.is_file() else []
    folder = path.parent if path.is_file() else path
    return clicked(part, "PERFANIM_OT_open_body_network", files=files, directory=str(folder), filepath="")


def test_the_network_comes_from_a_file_and_the_panel_says_so(part: Any, chosen: Any, own_cache: Path) -> None:
    if not body_network_file().is_file():
        pytest.skip("the body network is not here: perfanim network get")
    readiness = part("settings.readiness")
    assert readiness.network(chosen).problem == MISSING
    assert opened(part, body_network_file()) == "the body network is there"
    assert own_cache.read_bytes() == body_network_file().read_bytes()
    assert readiness.network(chosen).ready
    layout = Layout("column")
    part("preferences.body_network").draw(layout)
    assert "The body network is there" in layout.texts()


def test_another_file_under_its_name_is_told_and_not_kept(
    part: Any, own_cache: Path, errors: Any, tmp_path: Path
) -> None:
    (tmp_path / NETWORK_FILE).write_bytes(b"another network")
    with pytest.raises(errors.CaptureError, match="is damaged, or not the pose_landmark_full"):
        opened(part, tmp_path / NETWORK_FILE)
    with pytest.raises(errors.CaptureError, match="holds no body network; give pose_landmark_full"):
        opened(part, tmp_path)
    assert not own_cache.exists()


def test_a_damaged_network_is_told_before_a_capture(part: Any, chosen: Any, own_cache: Path) -> None:
    own_cache.parent.mkdir(parents=True)
    own_cache.write_bytes(b"half a network")
    problem = part("settings.readiness").network(chosen).problem
    assert f"{NETWORK_FILE}: is damaged, or not" in problem
    assert problem.endswith("get the body network again: click Get Body Network under Cameras, or open its file")


def test_without_online_access_nothing_is_downloaded(part: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    module = part("operators.body_network_operators")
    monkeypatch.setattr(module, "is_online_allowed", lambda: False)
    with pytest.raises(module.DownloadError, match="online access is off; enable Allow Online Access in Preferences"):
        clicked(part, "PERFANIM_OT_get_body_network")
    monkeypatch.setattr(module, "is_online_allowed", lambda: True)
    assert module.PERFANIM_OT_get_body_network.arguments(SimpleNamespace(), bpy.context) == ["network", "get"]
