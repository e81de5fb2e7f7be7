"""Build the kernel's libraries with Zig's C compiler, which brings what each platform needs.

python tools/build_kernel.py                     # into core/kernel/libraries, for all platforms
python tools/build_kernel.py --platform linux-x64
python tools/build_kernel.py --platform linux-x64 --sanitize --out DIR
"""

import argparse
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
        sys.stdout.write(f"{path}: {path.stat().st_size:,} bytes\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
