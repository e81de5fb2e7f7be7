import shutil
from pathlib import Path

import pytest
from perfanim.core.database import starter_database as module
from perfanim.core.database.starter_database import starter_database
from perfanim.core.database.store import open_database
from perfanim.core.errors import DatabaseError
from perfanim.core.system.assets import MOTION


@pytest.fixture
def few_clips(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    motion = tmp_path / "motion"
    motion.mkdir()
    shutil.copy(next(iter(sorted(MOTION.glob("walking-01*.bvh")))), motion)
    monkeypatch.setattr(module, "MOTION", motion)


def test_it_is_built_once(few_clips: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "cache_folder", lambda: tmp_path / "cache" / "perfanim")
    told: list[str] = []
    path = starter_database(lambda share, text: told.append(text))
    assert open_database(path).frames > 100
    assert set(told) == {"building the starter database"}
    before = path.stat().st_mtime_ns
    assert starter_database() == path
    assert open_database("starter").path == path
    assert path.stat().st_mtime_ns == before


def test_a_folder_that_cannot_be_made_is_told(few_clips: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "cache").write_text("a file")
    monkeypatch.setattr(module, "cache_folder", lambda: tmp_path / "cache" / "perfanim")
    with pytest.raises(DatabaseError, match="starter database cannot be written"):
        starter_database()
