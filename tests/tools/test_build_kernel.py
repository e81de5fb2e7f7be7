"""Check of the built libraries: files of a right and of a wrong kind, made here."""

import re
import struct

import pytest
from build_kernel import KERNEL, TARGETS, check_library

HEADERS = {
    "linux-x64": b"\x7fELF".ljust(18, b"\0") + struct.pack("<H", 62),
    "linux-arm64": b"\x7fELF".ljust(18, b"\0") + struct.pack("<H", 183),
    "windows-x64": b"MZ".ljust(0x3C, b"\0") + struct.pack("<I", 0x40) + b"PE\0\0" + struct.pack("<H", 0x8664),
    "windows-arm64": b"MZ".ljust(0x3C, b"\0") + struct.pack("<I", 0x40) + b"PE\0\0" + struct.pack("<H", 0xAA64),
    "macos-x64": b"\xcf\xfa\xed\xfe" + struct.pack("<I", 0x01000007),
    "macos-arm64": b"\xcf\xfa\xed\xfe" + struct.pack("<I", 0x0100000C),
}


def library(platform, needed=b"", left_out=None):
    sources = "".join(path.read_text(encoding="utf-8") for path in (KERNEL / "source").glob("*.h"))
    names = re.findall(r"EXPORT int64_t STAGE\((\w+)\)", sources)
    assert len(names) > 5
    functions = [f"pf_{name}{variant}\0".encode() for name in names for variant in ("", "_avx2") if name != left_out]
    return HEADERS[platform] + b"\0".join([b"", *functions, needed, b""])


@pytest.mark.parametrize("platform", TARGETS)
def test_a_library_of_the_platform_is_accepted(platform, tmp_path):
    (tmp_path / "library").write_bytes(library(platform))
    check_library(tmp_path / "library", platform)


@pytest.mark.parametrize("platform", TARGETS)
def test_a_library_of_another_platform_is_refused(platform, tmp_path):
    for other in set(TARGETS) - {platform}:
        (tmp_path / "library").write_bytes(library(other))
        with pytest.raises(ValueError, match=f"not a library for {platform}"):
            check_library(tmp_path / "library", platform)


def test_a_library_without_a_function_or_with_a_foreign_dependency_is_refused(tmp_path):
    (tmp_path / "library").write_bytes(library("linux-x64", left_out="fit_to_markers"))
    with pytest.raises(ValueError, match="lacks the function fit_to_markers"):
        check_library(tmp_path / "library", "linux-x64")
    (tmp_path / "library").write_bytes(library("linux-x64", b"libopenblas.so.0"))
    with pytest.raises(ValueError, match=r"needs libopenblas\.so\.0"):
        check_library(tmp_path / "library", "linux-x64")
