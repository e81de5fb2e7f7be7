"""Build the extension's archives: add-on and unmodified wheels.

    python tools/build_extension.py --out dist
    python tools/build_extension.py --platform linux-x64 --out dist

One archive is built per platform, by default all; it serves every Python, because no wheel in it is bound to one.
numpy is never included: Blender has its own, and an extension's copy would replace it for everyone. With --blender
PROGRAM, Blender's own `extension validate` checks the archives.
"""

import argparse
import fnmatch
import shlex
import shutil
import subprocess
import sys
import tempfile
import tomllib
import zipfile
from pathlib import Path

from manual_pages import manual_files

ROOT = Path(__file__).resolve().parents[1]

KERNELS = ROOT / "core" / "kernel" / "libraries"

REQUIREMENTS = tuple(
    line for line in (ROOT / "tools" / "wheels.txt").read_text(encoding="utf-8").split("\n") if "==" in line
)

_OLDEST_PYTHON = 11  # of Blender 4.2: 3.11

# Blender's name of a platform -> pip's names, most preferred first: for macOS the oldest.
PLATFORMS = {
    "linux-x64": ("manylinux_2_28_x86_64", "manylinux_2_17_x86_64", "manylinux2014_x86_64"),
    "windows-x64": ("win_amd64",),
    "macos-arm64": ("macosx_12_0_arm64", "macosx_13_0_arm64"),
    "macos-x64": ("macosx_10_13_x86_64", "macosx_12_0_x86_64", "macosx_13_0_x86_64"),
}


def main() -> int:
    """Build the chosen archives; return the exit status."""
    options = _parse()
    for platform in options.platform or PLATFORMS:
        target = build(platform, download_wheels(platform, options.wheels), options.out)
        if options.blender:
            validate(options.blender, target)
        sys.stdout.write(f"{target}\n")
    return 0


def _parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--platform", action="append", choices=PLATFORMS, help="Blender's platform (default all)")
    parser.add_argument("--out", type=Path, default=ROOT / "dist", help="folder for the archives")
    parser.add_argument("--wheels", type=Path, help="folder that keeps downloaded wheels (default OUT/wheels)")
    parser.add_argument("--blender", help="command of a Blender that checks the archives")
    options = parser.parse_args()
    options.wheels = options.wheels or options.out / "wheels"
    return options


def download_wheels(platform: str, folder: Path) -> list[Path]:
    """Return the wheels for a platform; missing ones are fetched into `folder` by pip."""
    folder = folder / platform
    folder.mkdir(parents=True, exist_ok=True)
    found = [_wheel(folder, requirement) for requirement in REQUIREMENTS]
    if not all(found):
        command = [sys.executable, "-m", "pip", "download", "--quiet", "--disable-pip-version-check"]
        command += ["--only-binary=:all:", "--no-deps", "--python-version", f"3.{_OLDEST_PYTHON}"]
        command += ["--dest", str(folder)]
        for name in PLATFORMS[platform]:
            command += ["--platform", name]
        subprocess.run([*command, *REQUIREMENTS], check=True)
        found = [_wheel(folder, requirement) for requirement in REQUIREMENTS]
    return [wheel for wheel in found if wheel is not None]


def _wheel(folder: Path, requirement: str) -> Path | None:
    name, version = requirement.split("==")
    return next(iter(sorted(folder.glob(f"{name.replace('-', '_')}-{version}-*.whl"))), None)


def build(platform: str, wheels: list[Path], out: Path) -> Path:
    """Write the archive and return its path.

    Raises:
        ValueError: A wheel is for another platform, or bound to one version of Python.
    """
    for wheel in wheels:
        if not fits(wheel.name, platform):
            raise ValueError(f"{wheel.name} is not for every Python on {platform}")
    text = (ROOT / "blender_manifest.toml").read_text(encoding="utf-8")
    manifest = tomllib.loads(text)
    out.mkdir(parents=True, exist_ok=True)
    target = out / f"{manifest['id']}-{manifest['version']}-{platform}.zip"
    with tempfile.TemporaryDirectory(dir=out) as folder:
        temporary = Path(folder) / target.name
        with zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("blender_manifest.toml", manifest_text(text, platform, wheels))
            for path in content(manifest["build"]["paths_exclude_pattern"]):
                if path.parent == KERNELS and platform not in path.name:
                    continue  # the kernel of another platform
                archive.write(path, path.relative_to(ROOT).as_posix())
            for name, data in manual_files():
                archive.writestr(f"manual/{name}", data)
            for wheel in wheels:
                archive.write(wheel, f"wheels/{wheel.name}", zipfile.ZIP_STORED)
        shutil.move(temporary, target)
    return target


def fits(wheel: str, platform: str) -> bool:
    """Return whether a wheel with this file name can be used by every Python of Blender on a platform."""
    _, pythons, abi, platforms = wheel.removesuffix(".whl").rsplit("-", 3)
    if abi == "none" and platforms == "any":
        return "py3" in pythons.split(".")
    is_stable = abi == "abi3" and int(pythons.removeprefix("cp3")) <= _OLDEST_PYTHON
    return is_stable and not set(platforms.split(".")).isdisjoint(PLATFORMS[platform])


def manifest_text(text: str, platform: str, wheels: list[Path]) -> str:
    """Return the manifest's text with platform and wheels."""
    lines = [f'platforms = ["{platform}"]', "wheels = ["]
    lines += [f'  "./wheels/{wheel.name}",' for wheel in wheels]
    head, table, tail = text.partition("[permissions]")
    if not table:
        raise ValueError("blender_manifest.toml has no [permissions] table")
    tail = tail.partition("[build]")[0]  # this table only concerns building
    return head + "\n".join([*lines, "]"]) + "\n\n" + table + tail.rstrip() + "\n"


def content(patterns: list[str]) -> list[Path]:
    """Return the files of the archive.

    They include untracked files, but not the manifest's exclude patterns.
    """
    found: list[Path] = []

    def visit(folder: Path) -> None:
        for path in sorted(folder.iterdir()):
            if path.name == "blender_manifest.toml" or _excluded(path, patterns):
                continue
            if path.is_dir():
                visit(path)
            else:
                found.append(path)

    visit(ROOT)
    return found


def _excluded(path: Path, patterns: list[str]) -> bool:
    """Return whether a pattern in .gitignore style matches the path.

    A leading / anchors the pattern at the root.
    """
    relative = path.relative_to(ROOT).as_posix()
    for pattern in patterns:
        if pattern.endswith("/") and not path.is_dir():
            continue
        bare = pattern.strip("/")
        name = relative if pattern.startswith("/") else path.name
        if fnmatch.fnmatchcase(name, bare) and (pattern.startswith("/") <= ("/" not in name)):
            return True
    return False


def validate(blender: str, archive: Path) -> None:
    """Check the archive with Blender's own tool."""
    tool = [*shlex.split(blender), "--factory-startup", "--command", "extension", "validate"]
    subprocess.run([*tool, str(archive.resolve())], check=True, stdout=sys.stderr)


if __name__ == "__main__":
    sys.exit(main())
