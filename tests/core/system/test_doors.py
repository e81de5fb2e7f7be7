"""Foreign files of every kind and name: refused at once, in one line of our own."""

import os
import socket
import subprocess
import sys
import tomllib
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import pytest
from perfanim.core.cli.batch.plan import read_plan
from perfanim.core.database.store import open_database
from perfanim.core.errors import MOST_TEXT, FormatError, PerfanimError
from perfanim.core.formats.markers.marker_files import read_take
from perfanim.core.formats.motion.motion_sources import motion_files
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.formats.take_file.take_reader import has_frames, read_take_file, summarise
from perfanim.core.geometry.rig_file import load_rig
from perfanim.core.markers.label_matching import load_names
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.prop import load_prop
from perfanim.core.markers.subject import load_subject
from perfanim.core.retarget.bone_map_files import load_bone_map, read_bone_map
from perfanim.core.system.files import exists, is_file, is_folder, open_foreign, read_bytes, read_toml, reading
from perfanim.core.vision.sources.image_files import read_image
from perfanim.core.vision.sources.source_kinds import open_image_source


def _motion_sources(path: Path) -> None:
    with motion_files([path]):
        pass


READERS: dict[str, tuple[Callable[[Path], object], ...]] = {
    "a.perftake": (read_take_file, summarise, has_frames),
    "a.toml": (
        read_toml, load_rig, load_subject, load_marker_set, load_prop, load_names, read_bone_map,
        lambda path: load_bone_map(str(path)), lambda path: read_plan(path, {}),
    ),
    "a.bvh": (read_motion, _motion_sources),
    "a.pfdb": (open_database,),
    "a.c3d": (read_take,),
    "a.trc": (read_take,),
    "a.csv": (read_take,),
    "a.tsv": (read_take,),
    "a.take.npz": (read_take,),
    "a.png": (read_image, lambda path: open_image_source(path)),
    "a.mp4": (lambda path: open_image_source(path),),
}  # fmt: skip
CASES = [(name, read) for name, readers in READERS.items() for read in readers]
IDS = [f"{name}-{index}" for index, (name, _) in enumerate(CASES)]


def _refused(read: Callable[[Path], object], path: Path) -> None:
    with pytest.raises(PerfanimError) as caught:
        read(path)
    assert len(str(caught.value)) <= MOST_TEXT
    assert "\n" not in str(caught.value)
    str(caught.value).encode("utf-8")


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no named pipes")
@pytest.mark.parametrize(("name", "read"), CASES, ids=IDS)
def test_what_is_no_regular_file_is_refused_without_waiting(
    name: str, read: Callable[[Path], object], tmp_path: Path
) -> None:
    os.mkfifo(tmp_path / name)
    _refused(read, tmp_path / name)
    (tmp_path / name).unlink()
    (tmp_path / name).symlink_to("/dev/zero")
    _refused(read, tmp_path / name)
    (tmp_path / name).unlink()
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(tmp_path / "s"))
        (tmp_path / name).symlink_to(tmp_path / "s")
        _refused(read, tmp_path / name)
    (tmp_path / name).unlink()
    (tmp_path / name).mkdir()
    if read is not _motion_sources:  # a folder of motion is as good as a file
        _refused(read, tmp_path / name)


@pytest.mark.parametrize("stem", ["a\0b", "\ud800", "\udcff", "x" * 300, "y/" * 3000])
@pytest.mark.parametrize(("name", "read"), CASES, ids=IDS)
def test_names_that_no_file_can_have_are_refused(
    name: str, read: Callable[[Path], object], stem: str, tmp_path: Path
) -> None:
    _refused(read, tmp_path / f"{stem}{name}")


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
    with pytest.raises(FormatError, match="has 5 bytes, 4 at most"):
        read_bytes(tmp_path / "file", most=4)


def test_whatever_a_parser_raises_becomes_one_error() -> None:
    for error in (KeyError("a"), OverflowError(), RecursionError("deep"), MemoryError(), ZeroDivisionError("x")):
        with pytest.raises(FormatError, match="f: is damaged"), reading("f"):
            raise error
    with pytest.raises(KeyboardInterrupt), reading("f"):
        raise KeyboardInterrupt


NUMBERS = ("inf", "nan", "9" * 5000, "9" * 400, "1e300")
HOSTILE = {
    "nested": "a = " + "[" * 5000 + "]" * 5000,
    "tables": "[" + ".".join("a" * 5000) + "]\nb = 1",
    "inline": "a = " + "{a = " * 40 + "1" + "}" * 40,
    "nul": 'take = "a\\u0000b"',
} | {f"number {text[:4]} {len(text)}": f"[cam_0]\nsize = [{text}, 480]" for text in NUMBERS}


LARGE = {
    "dotted key": ".".join("a" * 20_000) + " = 1",
    "dotted header": "[" + " . ".join("a" * 20_000) + "]",
    "dots of quoted names": ".".join(['"a"'] * 20_000) + " = 1",
    "dots after four quotes": 'a = ["""x"""", "y"]\n' + ".".join("a" * 20_000) + " = 1",
    "tables": "".join(f"[a{number}]\n" for number in range(100_000)),
    "deep tables": "".join(f"[a{number}{'.b' * 31}]\n" for number in range(5000)),
    "inline tables": "a = [" + "{b.c = 1}," * 60_000 + "]",
    "keys": "".join(f"a{number} = 1\n" for number in range(300_000)),
    "digits": "a = " + "1" * 1_000_000 + ".5",
}


@pytest.mark.parametrize("text", LARGE.values(), ids=LARGE)
def test_toml_that_would_take_far_more_than_its_bytes_is_refused_before_it_is_parsed(text: str, tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text(text)
    tracemalloc.start()
    with pytest.raises(FormatError, match=r"a\.toml: is not valid TOML \(.*more than"):
        read_toml(tmp_path / "a.toml")
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 4 * len(text) + (1 << 20)


LEGAL = {
    "dots in texts": f'a = "{"x." * 5000}"\nb = \'{"y." * 5000}\'\n"{"z." * 5000}" = 1',
    "dots in a comment": "# " + "." * 50_000 + "\na = 1 # [" + "=" * 300_000,
    "long texts": 'a = """\n' + "[x.y]" * 10_000 + '\\\\"" """\nb = ' + "'''" + "it's [a.b]" * 10_000 + "''''",
    "four quotes": 'a = """"x"""""\nb = 1.5',
    "32 names": ".".join("a" * 32) + " = 1",
    "many fractions": "a = [" + ", ".join(["-0.125"] * 20_000) + "]",
    "many takes": '[[take]]\ntake = "a.c3d"\nsubject = "b.toml"\nrate = 30.0\n' * 5000,
    "escapes": r'a = "\\"' + "\n" + r'b = "\"#[a.b"' + "\n",
}


@pytest.mark.parametrize("text", LEGAL.values(), ids=LEGAL)
def test_legal_toml_is_read_whatever_its_texts_hold(text: str, tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text(text)
    assert read_toml(tmp_path / "a.toml") == tomllib.loads(text)


@pytest.mark.parametrize("text", HOSTILE.values(), ids=HOSTILE)
def test_hostile_toml_is_refused(text: str, tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text(text)
    for read in READERS["a.toml"]:
        _refused(read, tmp_path / "a.toml")
    with pytest.raises(FormatError, match=r"a\.toml: is not valid TOML"):
        read_toml(tmp_path / "a.toml")


def test_digits_that_are_no_numbers_in_a_camera(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text('["cam_²"]\nname = "x"\n["cam_' + "9" * 5000 + '"]\nname = "y"\n')
    _refused(load_rig, tmp_path / "a.toml")


@pytest.mark.parametrize("key", ["a" * 100_000, "\u00e4" * 9000])
def test_long_keys_and_values_are_shortened(key: str, tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text(f'"{key}" = "{key}"\n[joints]\n"{key}" = "{key}"\n[[take]]\ntake = "a"\n')
    for read in READERS["a.toml"][1:5] + READERS["a.toml"][6:]:
        _refused(read, tmp_path / "a.toml")


@pytest.mark.skipif(sys.platform != "linux", reason="other systems allow no such names")
def test_names_that_are_no_text_reach_no_library(tmp_path: Path) -> None:
    folder = os.fsencode(tmp_path)
    path = os.path.join(folder, b"gone\xff.c3d")  # noqa: PTH118 - bytes
    for extra in ([], [b"--json"]):
        line = [os.fsencode(sys.executable), b"-m", b"perfanim.core.cli.main", b"take", b"info", path, *extra]
        done = subprocess.run(line, capture_output=True, check=False)
        assert done.returncode == 1
        assert done.stderr.count(b"\n") == 1
        assert b"Traceback" not in done.stderr
