"""Build the kernel's libraries with Zig's C compiler, which brings what each platform needs, and check their format.

python tools/build_kernel.py                     # into core/kernel/libraries, for all platforms
python tools/build_kernel.py --platform linux-x64
python tools/build_kernel.py --platform linux-x64 --sanitize --out DIR
"""

import argparse
import re
import struct
import subprocess
import sys
from pathlib import Path

KERNEL = Path(__file__).resolve().parents[1] / "core" / "kernel"
# platform -> Zig's name of it, with the oldest glibc, and the ending of a library's name
TARGETS = {
    "linux-x64": ("x86_64-linux-gnu.2.28", "so"),
    "linux-arm64": ("aarch64-linux-gnu.2.28", "so"),
    "windows-x64": ("x86_64-windows-gnu", "dll"),
    "windows-arm64": ("aarch64-windows-gnu", "dll"),
    "macos-x64": ("x86_64-macos.11.0", "dylib"),
    "macos-arm64": ("aarch64-macos.11.0", "dylib"),
}
_FLAGS = (
    "-std=c99",
    "-Wall",
    "-Wextra",
    "-Wno-psabi",
    "-Werror",
    "-shared",
    "-fPIC",
    "-fvisibility=hidden",
    "-ffp-contract=off",
)
# a library of macOS names itself, by default with its folder
_SYSTEM_FLAGS = {"linux": ("-lm",), "windows": (), "macos": ("-Wl,-install_name,@rpath/perfanim_kernel.dylib",)}
_SANITIZED = ("-O1", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
# ending -> where a file says for which processor it is: bytes that come before, the number's type, and the numbers
_PROCESSORS = {
    "so": (b"\x7fELF", "<18xH", {"x64": 62, "arm64": 183}),
    "dll": (b"MZ", "<4xH", {"x64": 0x8664, "arm64": 0xAA64}),
    "dylib": (b"\xcf\xfa\xed\xfe", "<4xI", {"x64": 0x01000007, "arm64": 0x0100000C}),
}
# what every computer of the platform has
_SYSTEM_LIBRARIES = r"lib[cm]\.so\.6|KERNEL32\.dll|api-ms-win-crt-[\w-]+\.dll|/usr/lib/libSystem\.B\.dylib"
_LIBRARY = re.compile(rb"[\w.@/+-]+\.(?:dll|so(?:\.\d+)*|dylib)\b")


def check_library(path: Path, platform: str) -> None:
    """Check a library's format, processor, functions, and the libraries that it needs.

    Raises:
        ValueError: Something is wrong; the text tells what.
    """
    data, ending, processor = path.read_bytes(), TARGETS[platform][1], platform.split("-")[1]
    magic, kind, numbers = _PROCESSORS[ending]
    at = struct.unpack_from("<I", data, 0x3C)[0] if data.startswith(b"MZ") else 0
    if not data.startswith(magic) or struct.unpack_from(kind, data, at)[0] != numbers[processor]:
        raise ValueError(f"{path} is not a library for {platform}")
    sources = "".join(each.read_text(encoding="utf-8") for each in sorted((KERNEL / "source").glob("*.h")))
    variants = ("", "_avx2") if processor == "x64" else ("",)
    for name in re.findall(r"EXPORT int64_t STAGE\((\w+)\)", sources):
        for variant in variants:
            if f"pf_{name}{variant}\0".encode() not in data:
                raise ValueError(f"{path} lacks the function {name}{variant}")
    needed = {each.decode() for each in _LIBRARY.findall(data) if b"perfanim_kernel" not in each}
    if foreign := sorted(each for each in needed if not re.fullmatch(_SYSTEM_LIBRARIES, each)):
        raise ValueError(f"{path} needs {', '.join(foreign)}")


def main() -> int:
    """Build the chosen libraries; return the exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--platform", action="append", choices=TARGETS, help="platform (default all)")
    parser.add_argument(
        "--sanitize",
        action="store_true",
        help="check addresses and undefined behaviour; built by cc, because Zig has no address sanitizer",
    )
    parser.add_argument("--out", type=Path, default=KERNEL / "libraries", help="folder for the libraries")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    for platform in options.platform or TARGETS:
        target, ending = TARGETS[platform]
        path = options.out / f"perfanim_kernel-{platform}.{ending}"
        zig = [sys.executable, "-m", "ziglang", "cc", "-target", target, "-O3", "-s"]
        command = ["cc", *_SANITIZED] if options.sanitize else zig
        command += [*_FLAGS, *_SYSTEM_FLAGS[platform.split("-")[0]], "-o", str(path)]
        subprocess.run([*command, str(KERNEL / "source" / "kernel.c")], check=True)
        (options.out / "kernel.lib").unlink(missing_ok=True)  # for linking on Windows, which nobody does
        if not options.sanitize:
            check_library(path, platform)
        sys.stdout.write(f"{path}: {path.stat().st_size:,} bytes\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
