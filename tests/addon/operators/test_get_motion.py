"""Motion data from the network, as the button gets them."""

import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import pytest
from clicked import run_job
from file_site import motion_archive, serving
from perfanim.core.database.store import open_database
from perfanim.perfanim_addon.jobs.job import Job, command
from ticking import PATIENCE_S


def asked(part: Any, **chosen: Any) -> tuple[Any, SimpleNamespace]:
    """Return the operator, and its dialog with what was chosen there."""
    operator = part("operators.database_operators").PERFANIM_OT_get_motion
    dialog = SimpleNamespace(
        **({"collection": "ADDRESS", "address": "", "only": "", "mirror": False, "cull": False} | chosen)
    )
    dialog.build_options = lambda context, name: operator.build_options(dialog, context, name)
    return operator, dialog


def test_an_archive_from_an_address_is_used_at_once(part: Any, tmp_path: Path) -> None:
    motion_archive(tmp_path / "some walks.zip")
    try:
        with serving(tmp_path) as address:
            operator, dialog = asked(part, address=f" {address}/some%20walks.zip ", mirror=True)
            text = run_job(part, operator, dialog)
        path = Path(bpy.context.scene.perfanim.database)
        assert path.name == "some-walks.pfdb"
        database = open_database(path)
        assert len(database.clips) == 4
        assert text.startswith(f"{database.frames:,} frames imported")
    finally:
        bpy.context.scene.perfanim.database = ""


def test_stop_during_the_download_keeps_what_came_and_changes_nothing(part: Any, tmp_path: Path) -> None:
    before = bpy.context.scene.perfanim.database
    motion_archive(tmp_path / "walks.tar")
    folder = part("operators.database_operators")._folder()
    limit = time.monotonic() + PATIENCE_S
    with serving(tmp_path, pause_s=0.05) as address:
        operator, dialog = asked(part, address=f"{address}/walks.tar")
        running = Job(operator.title, operator.panel, command(operator.arguments(dialog, bpy.context)), None)
        try:
            while not running.fraction > 0.05:
                running.tick()
                assert not running.ended and time.monotonic() < limit
                time.sleep(0.01)
            assert "downloading walks.tar" in running.text
        finally:
            running.close()  # as the button Stop does
        assert running.ended and running.summary is None
        assert {path.name for path in folder.iterdir()} == {".walks.tar.part", ".walks.tar.part.json"}
        assert bpy.context.scene.perfanim.database == before
    with serving(tmp_path) as address:
        operator, dialog = asked(part, address=f"{address}/walks.tar")
        try:
            assert "frames imported" in run_job(part, operator, dialog)
        finally:
            bpy.context.scene.perfanim.database = before
    assert [path.name for path in folder.iterdir()] == ["walks.tar"]


def test_several_subjects_and_behaviours_are_taken(part: Any) -> None:
    operator, dialog = asked(part, address="http://127.0.0.1:9/a.zip", only=" 09_*, boxing,,*walk* ")
    arguments = operator.arguments(dialog, bpy.context)
    included = [arguments[at + 1] for at, word in enumerate(arguments) if word == "--include"]
    assert included == ["09_*", "boxing", "*walk*"]


@pytest.mark.parametrize("chosen", [{"collection": "cmu"}, {"address": "https://example.org/walks.zip"}])
def test_without_online_access_nothing_is_asked_for(part: Any, monkeypatch: Any, chosen: dict[str, str]) -> None:
    module = part("operators.database_operators")
    monkeypatch.setattr(module, "is_online_allowed", lambda: False)
    operator, dialog = asked(part, **chosen)
    with pytest.raises(module.DownloadError, match="online access is off; enable Allow Online Access in Preferences"):
        operator.arguments(dialog, bpy.context)
    monkeypatch.setattr(module, "is_online_allowed", lambda: True)
    assert operator.arguments(dialog, bpy.context)[:2] == ["database", "get"]


def test_an_address_that_is_none_is_told(part: Any) -> None:
    for address in ("", "walks.zip", "file:///walks.zip"):
        operator, dialog = asked(part, address=address)
        with pytest.raises(part("operators.database_operators").DownloadError, match="not an http or https address"):
            operator.arguments(dialog, bpy.context)
