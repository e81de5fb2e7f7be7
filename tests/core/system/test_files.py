import errno
import math
import os
import stat
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from perfanim.core.errors import FormatError
from perfanim.core.system.files import (
    atomic_path,
    clean_folder,
    exists,
    is_file,
    is_folder,
    open_foreign,
    read_bytes,
    read_toml,
    reading,
    write_toml,
)  # fmt: skip


def test_a_file_appears_whole_in_a_new_folder(tmp_path: Path) -> None:
    target = tmp_path / "new" / "a.txt"
    with atomic_path(target) as temporary:
        assert temporary.parent == target.parent
        assert temporary.suffix == ".txt"
        temporary.write_text("whole")
        assert not target.exists()
    assert target.read_text() == "whole"
    assert [path.name for path in target.parent.iterdir()] == ["a.txt"]


def test_the_temporary_file_of_a_name_without_a_stem_has_its_ending(tmp_path: Path) -> None:
    """Blender's glTF exporter adds its ending to other names, so it wrote beside the temporary file."""
    for name in (".glb", "..glb", ".a.glb"):
        with atomic_path(tmp_path / name) as temporary:
            assert temporary.name.startswith(".") and temporary.suffix == ".glb"
            temporary.write_text("whole")
        assert [path.name for path in tmp_path.iterdir()] == [name]
        (tmp_path / name).unlink()


def test_an_error_while_writing_leaves_the_old_file(tmp_path: Path) -> None:
    target = tmp_path / "a.txt"
    target.write_text("old")
    with pytest.raises(ZeroDivisionError), atomic_path(target) as temporary:
        temporary.write_text("half of the n")
        raise ZeroDivisionError
    assert target.read_text() == "old"
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]


def test_a_link_stays_a_link_to_the_new_file(tmp_path: Path) -> None:
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "link.txt").symlink_to(tmp_path / "elsewhere" / "a.txt")  # which may not be there yet
    for text in ("first", "second"):
        with atomic_path(tmp_path / "link.txt") as temporary:
            temporary.write_text(text)
        assert (tmp_path / "link.txt").is_symlink()
        assert (tmp_path / "elsewhere" / "a.txt").read_text() == text
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["a.txt", "elsewhere", "link.txt"]


def test_what_a_killed_process_left_behind_is_removed(tmp_path: Path) -> None:
    names = {".a.0123abcd.txt": 7200, ".a.9876dcba.txt": 60, ".a.own.txt": 7200, ".b.0123abcd.txt": 7200, ".a.x": 7200}
    for name, age_s in names.items():
        (tmp_path / name).write_text("half")
        written_s = time.time() - age_s
        os.utime(tmp_path / name, (written_s, written_s))
    with atomic_path(tmp_path / "a.txt") as temporary:
        temporary.write_text("whole")
    left = {path.name for path in tmp_path.iterdir()}
    assert left == {*names, "a.txt"} - {".a.0123abcd.txt"}


def test_what_killed_processes_left_in_a_folder_of_ours_is_removed(tmp_path: Path) -> None:
    left = {
        ".walk.take.a1b2c3d4.npz": "",
        ".cut.0_x0aaaa.perftake": "",
        ".walk.bvh.lock": "",
        ".motion.ab3defgh": "folder",
    }
    ours = {
        "walk.a1b2c3d4.npz": "",
        ".project.settings.json": "",
        ".a1b2c3d4": "",
        ".walk.A1B2C3D4.npz": "",
        ".lock": "",
        ".folder": "folder",
    }
    for name, kind in (left | ours).items():
        (tmp_path / name).mkdir() if kind else (tmp_path / name).write_text("half")
    (tmp_path / ".motion.ab3defgh" / "part").write_text("half")
    (tmp_path / ".link.a1b2c3d4.npz").symlink_to(tmp_path / "walk.a1b2c3d4.npz")
    clean_folder(tmp_path)  # all of it is new
    assert len(list(tmp_path.iterdir())) == len(left) + len(ours) + 1
    for path in tmp_path.rglob("*"):
        os.utime(path, (0.0, 0.0), follow_symlinks=False)
    with atomic_path(tmp_path / "run.bvh") as temporary:
        os.utime(tmp_path / ".run.bvh.lock", (0.0, 0.0))
        clean_folder(tmp_path)
        assert {path.name for path in tmp_path.iterdir()} == {
            *ours,
            ".link.a1b2c3d4.npz",
            ".run.bvh.lock",
            temporary.name,
        }
    clean_folder(tmp_path / "gone")


def test_permissions_are_those_of_any_new_file(tmp_path: Path) -> None:
    (tmp_path / "plain").write_text("")
    with atomic_path(tmp_path / "a.txt") as temporary:
        temporary.write_text("")
    assert stat.S_IMODE((tmp_path / "a.txt").stat().st_mode) == stat.S_IMODE((tmp_path / "plain").stat().st_mode)


def test_a_target_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(FormatError, match="cannot be written"), atomic_path(tmp_path / "file" / "a.txt"):
        pass
    (tmp_path / "folder").mkdir()
    with pytest.raises(FormatError, match="folder: cannot be written"), atomic_path(tmp_path / "folder") as temporary:
        temporary.write_text("")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["file", "folder"]


def test_a_full_disk_is_told_in_plain_words(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match="No space left"), atomic_path(tmp_path / "a.txt"):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    with pytest.raises(FileNotFoundError), atomic_path(tmp_path / "a.txt"):
        (tmp_path / "source").read_text()  # another file's trouble stays its own
    assert not any(tmp_path.iterdir())


def test_toml_round_trip(tmp_path: Path) -> None:
    tables = {
        "text": 'quote " backslash \\ newline \n bell \x07 umlaut ä',
        "whole": -3,
        "number": 0.1,
        "tiny": 1e-300,
        "yes": True,
        "odd key.ä": "kept",
        "matrix": np.array([[1.0, 2.5], [3.0, -4.0]]),
        "empty": [],
        "table": {"inner": {"deep": 1}, "after": "x"},
        "row": [{"name": "a", "at": [1, 2], "sub": {"n": 1}}, {"name": "b", "at": []}],
        "none": {},
    }
    write_toml(tmp_path / "a.toml", tables)
    assert read_toml(tmp_path / "a.toml") == tables | {"matrix": [[1.0, 2.5], [3.0, -4.0]]}


def test_toml_keeps_numbers_exactly(tmp_path: Path) -> None:
    values = np.random.default_rng(0).normal(size=50).tolist()
    write_toml(tmp_path / "a.toml", {"values": values})
    assert read_toml(tmp_path / "a.toml") == {"values": values}
    write_toml(tmp_path / "a.toml", {"values": [1.0, math.inf]})
    with pytest.raises(FormatError, match="a number in values is not finite"):
        read_toml(tmp_path / "a.toml")


def test_what_toml_cannot_hold_is_refused_without_a_file(tmp_path: Path) -> None:
    with pytest.raises(TypeError, match="NoneType"):
        write_toml(tmp_path / "a.toml", {"a": None})
    assert not any(tmp_path.iterdir())


def test_unreadable_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FormatError, match=r"none: cannot be read \(No such file"):
        read_bytes(tmp_path / "none")
    with pytest.raises(FormatError, match="cannot be read"):
        read_bytes(tmp_path)
    for content in (b"a = ", b"\xff\xfea\x00", b"\xffa", b"[a]\n[a]"):
        (tmp_path / "a.toml").write_bytes(content)
        with pytest.raises(FormatError, match=r"a\.toml: is not valid TOML"):
            read_toml(tmp_path / "a.toml")


def test_only_regular_files_and_folders_count(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"12345")
    assert is_file(tmp_path / "file")
    assert not is_folder(tmp_path / "file")
    assert is_folder(tmp_path)
    assert exists(tmp_path) and exists(tmp_path / "file") and not exists(tmp_path / "gone")
    assert not any(check(name) for check in (exists, is_file, is_folder) for name in ("a\0b", "\ud800", "x" * 300))
    with open_foreign(tmp_path / "file") as file:
        assert file.read() == b"12345"
    assert read_bytes(tmp_path / "file", most=5) == b"12345"
    with pytest.raises(FormatError, match="has 5 bytes, but at most 4 are allowed"):
        read_bytes(tmp_path / "file", most=4)


def test_any_exception_of_a_parser_becomes_one_error() -> None:
    for error in (KeyError("a"), OverflowError(), RecursionError("deep"), MemoryError(), ZeroDivisionError("x")):
        with pytest.raises(FormatError, match="f: is damaged"), reading("f"):
            raise error
    with pytest.raises(KeyboardInterrupt), reading("f"):
        raise KeyboardInterrupt


@pytest.mark.skipif(sys.platform != "linux", reason="other systems allow no such names")
def test_undecodable_file_name_is_refused_in_one_line(tmp_path: Path) -> None:
    folder = os.fsencode(tmp_path)
    path = os.path.join(folder, b"gone\xff.c3d")  # noqa: PTH118 - bytes
    for extra in ([], [b"--json"]):
        line = [os.fsencode(sys.executable), b"-m", b"perfanim.core.cli.main", b"take", b"info", path, *extra]
        done = subprocess.run(line, capture_output=True, check=False)
        assert done.returncode == 1
        assert done.stderr.count(b"\n") == 1
        assert b"Traceback" not in done.stderr
