"""Which library is loaded, and what is told where none is; none is needed here."""

import platform
import sys

import numpy as np
import pytest
from perfanim.core.kernel import library
from perfanim.core.kernel.library import Stage, library_name, load, use_kernel

HERE = library_name(sys.platform, platform.machine())


@pytest.mark.parametrize(
    ("system", "machine", "name"),
    [
        ("linux", "x86_64", "perfanim_kernel-linux-x64.so"),
        ("linux", "aarch64", "perfanim_kernel-linux-arm64.so"),
        ("win32", "AMD64", "perfanim_kernel-windows-x64.dll"),
        ("win32", "ARM64", "perfanim_kernel-windows-arm64.dll"),
        ("darwin", "arm64", "perfanim_kernel-macos-arm64.dylib"),
        ("freebsd14", "amd64", None),
        ("linux", "riscv64", None),
    ],
)
def test_names(system: str, machine: str, name: str | None) -> None:
    assert library_name(system, machine) == name


def test_numpy_can_be_forced() -> None:
    assert load("off") == (None, "not used, because PERFANIM_KERNEL is off", "")


def test_without_a_library_numpy_is_used(tmp_path) -> None:
    assert load(str(tmp_path)) == (None, f"not there for {sys.platform} on {platform.machine()}", "")


def test_a_damaged_library_is_told(tmp_path) -> None:
    (tmp_path / HERE).write_bytes(b"\x7fELF and nothing more")
    found = load(str(tmp_path))
    assert found.library is None
    assert found.text.startswith("cannot be loaded: ")


class OtherVersion:
    """A library that loads, but of another version."""

    def __init__(self, path: str) -> None:
        assert path.endswith(str(HERE))

    def pf_version(self) -> int:
        return library.VERSION + 1


def test_another_version_is_not_used(tmp_path, monkeypatch) -> None:
    (tmp_path / HERE).write_bytes(b"")
    monkeypatch.setattr(library.ctypes, "CDLL", OtherVersion)
    found = load(str(tmp_path))
    assert found == (None, f"not used, because it has version {library.VERSION + 1}, not {library.VERSION}", "")


def test_sources_and_loader_have_one_version() -> None:
    source = (library.FOLDER.parent / "source" / "kernel.c").read_text(encoding="utf-8")
    assert f"#define VERSION {library.VERSION} " in source


def test_a_stage_has_two_bodies(monkeypatch) -> None:
    chosen = Stage(lambda value: ("numpy", value), lambda value: ("compiled", value))
    monkeypatch.setattr(Stage, "is_compiled", False)
    assert chosen(1) == ("numpy", 1)
    monkeypatch.setattr(Stage, "is_compiled", True)
    assert chosen(2) == ("compiled", 2)


def test_the_kernel_is_used_only_if_it_is_loaded(monkeypatch) -> None:
    before = Stage.is_compiled
    monkeypatch.setattr(library, "KERNEL", library.Loaded(None, "not there"))
    assert not use_kernel(True)
    with pytest.raises(RuntimeError, match="not there"):
        library.function("markers", "p")()
    Stage.is_compiled = before


def test_only_contiguous_arrays_have_an_address() -> None:
    values = np.arange(6.0).reshape(2, 3)
    values.flags.writeable = False
    assert library.address(values) == values.ctypes.data
    for other in (values.T, np.arange(6.0)[::2]):
        with pytest.raises((TypeError, ValueError), match="contiguous"):
            library.address(other)
