"""Two writers of one output: the second is told; a killed one hinders nobody."""

import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from perfanim.core.errors import FormatError
from perfanim.core.system.files import atomic_path
from perfanim.core.system.outputs import check_no_input, claimed

WRITE = """
import sys
from perfanim.core.errors import FormatError
from perfanim.core.system.files import atomic_path
try:
    with atomic_path(sys.argv[1]) as temporary:
        temporary.write_text("another's")
except FormatError as error:
    sys.exit(str(error))
"""


def written_by_another(path: Path, environment: dict[str, str] | None = None) -> str:
    """Return what another process is told when it writes the file."""
    done = subprocess.run(
        [sys.executable, "-c", WRITE, str(path)], env=environment, capture_output=True, text=True, check=False
    )
    return done.stderr.strip()


def test_the_second_of_two_writers_is_told(tmp_path: Path) -> None:
    target = tmp_path / "a.txt"
    (tmp_path / "link.txt").symlink_to(target)
    with atomic_path(target) as temporary:
        temporary.write_text("mine")
        for name in (target, tmp_path / "link.txt"):
            assert "a.txt: is being written by another program" in written_by_another(name)
        with pytest.raises(FormatError, match="is being written by another program"), atomic_path(target):
            pass
    assert target.read_text() == "mine"
    assert written_by_another(target) == ""
    assert target.read_text() == "another's"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.txt", "link.txt"]


def test_the_lock_of_a_killed_writer_hinders_nobody(tmp_path: Path) -> None:
    (tmp_path / ".a.txt.lock").touch()
    with atomic_path(tmp_path / "a.txt") as temporary:
        temporary.write_text("mine")
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]


def test_a_folder_where_no_lock_can_be_made_is_written(tmp_path: Path) -> None:
    (tmp_path / ".a.txt.lock").mkdir()
    with atomic_path(tmp_path / "a.txt") as temporary:
        temporary.write_text("mine")
    assert (tmp_path / "a.txt").read_text() == "mine"


def test_many_writers_at_once_leave_one_whole_file(tmp_path: Path) -> None:
    target, texts = tmp_path / "a.txt", [str(number) * 1000 for number in range(8)]

    def write(text: str) -> int:
        told = 0
        for _ in range(50):
            try:
                with atomic_path(target) as temporary:
                    inside.append(text)
                    assert inside == [text]  # nobody else is in here
                    temporary.write_text(text)
                    inside.remove(text)
            except FormatError:
                told += 1
        return told

    inside: list[str] = []
    with ThreadPoolExecutor(len(texts)) as threads:
        told = list(threads.map(write, texts))
    assert sum(told) < 50 * len(texts)
    assert target.read_text() in texts
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]


def test_an_output_is_claimed_for_a_command_and_its_processes(tmp_path: Path) -> None:
    target = tmp_path / "a.txt"
    before = dict(os.environ)
    with claimed(target):
        assert "is being written" in written_by_another(target, before)
        assert written_by_another(target) == ""  # its own process
        with atomic_path(target) as temporary:
            temporary.write_text("mine")
        assert written_by_another(tmp_path / "b.txt", before) == ""
    assert dict(os.environ) == before
    assert written_by_another(target) == ""
    with claimed(tmp_path / "new" / "a.txt"):  # which makes no folder
        assert not (tmp_path / "new").exists()


def test_an_output_that_is_an_input_is_refused_by_whatever_name(tmp_path: Path) -> None:
    (tmp_path / "a.c3d").touch()
    (tmp_path / "link.c3d").symlink_to(tmp_path / "a.c3d")
    (tmp_path / "hard.c3d").hardlink_to(tmp_path / "a.c3d")
    check_no_input(tmp_path / "b.c3d", [tmp_path / "a.c3d", "no\0name", tmp_path / "gone"])
    for name in ("a.c3d", "link.c3d", "hard.c3d"):
        with pytest.raises(
            FormatError, match=r"a\.c3d: is an input and would be overwritten; give the output another name"
        ):
            check_no_input(tmp_path / name, [tmp_path / "a.c3d"])
