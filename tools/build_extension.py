"""Build the extension's archive for one Python and one platform: the add-on and the wheels that it needs, unmodified.

    python tools/build_extension.py --python 3.13 --platform linux-x64 --out dist

numpy is never among the wheels: Blender has its own, and an extension's copy would become everybody's. scipy has a
wheel for every Python, and Blender 4.2 takes the wrong one when a manifest lists two, hence one archive per Python and
platform.
With --blender PROGRAM the archive is checked by Blender's own `extension validate`.
"""

import argparse
import fnmatch
import shutil
import subprocess
import sys
import tempfile
import tomllib
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]

# scipy 1.15 is the last line that takes numpy 1.24 to 2.x, as Blender 4.2 to 5.2 have them.
REQUIREMENTS = ("scipy==1.15.3", "opencv-contrib-python-headless==4.11.0.86")

# Blender's name of a platform -> what pip calls it, the newest first.
PLATFORMS = {
    "linux-x64": ("manylinux_2_28_x86_64", "manylinux_2_17_x86_64", "manylinux2014_x86_64"),
    "windows-x64": ("win_amd64",),
    "macos-arm64": ("macosx_14_0_arm64", "macosx_13_0_arm64", "macosx_12_0_arm64"),
    "macos-x64": ("macosx_14_0_x86_64", "macosx_13_0_x86_64", "macosx_12_0_x86_64", "macosx_10_14_x86_64"),
}


def main() -> int:
    """Build what the command line asks for; returns the exit status."""
    options = _parse()
    wheels = download_wheels(options.python, options.platform, options.wheels)
    target = build(options.python, options.platform, wheels, options.out)
    if options.blender:
        validate(options.blender, target)
    sys.stdout.write(f"{target}\n")
    return 0


def _parse() -> argparse.Namespace:
    version = f"{sys.version_info.major}.{sys.version_info.minor}"
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--python", default=version, help=f"Python of the Blender (default {version})")
    parser.add_argument("--platform", default="linux-x64", choices=sorted(PLATFORMS), help="Blender's platform")
    parser.add_argument("--out", type=Path, default=ROOT / "dist", help="folder for the archive")
    parser.add_argument("--wheels", type=Path, help="folder that keeps downloaded wheels (default OUT/wheels)")
    parser.add_argument("--blender", help="Blender program that checks the archive")
    options = parser.parse_args()
    options.wheels = options.wheels or options.out / "wheels"
    return options


def download_wheels(python: str, platform: str, folder: Path) -> list[Path]:
    """Return the wheels for a Python ("3.13") and a platform, fetched by pip into `folder` unless they are there."""
    folder = folder / f"{python}-{platform}"
    folder.mkdir(parents=True, exist_ok=True)
    found = [_wheel(folder, requirement) for requirement in REQUIREMENTS]
    if not all(found):
        command = [sys.executable, "-m", "pip", "download", "--quiet", "--disable-pip-version-check"]
        command += ["--only-binary=:all:", "--no-deps", "--python-version", python, "--dest", str(folder)]
        for name in PLATFORMS[platform]:
            command += ["--platform", name]
        subprocess.run([*command, *REQUIREMENTS], check=True)
        found = [_wheel(folder, requirement) for requirement in REQUIREMENTS]
    return [wheel for wheel in found if wheel is not None]


def _wheel(folder: Path, requirement: str) -> Path | None:
    name, version = requirement.split("==")
    return next(iter(sorted(folder.glob(f"{name.replace('-', '_')}-{version}-*.whl"))), None)


def build(python: str, platform: str, wheels: list[Path], out: Path) -> Path:
    """Write the archive; returns its path."""
    text = (ROOT / "blender_manifest.toml").read_text(encoding="utf-8")
    manifest = tomllib.loads(text)
    out.mkdir(parents=True, exist_ok=True)
    tag = python.replace(".", "")
    target = out / f"{manifest['id']}-{manifest['version']}-py{tag}-{platform}.zip"
    with tempfile.TemporaryDirectory(dir=out) as folder:
        temporary = Path(folder) / target.name
        with zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("blender_manifest.toml", manifest_text(text, platform, wheels))
            for path in content(manifest["build"]["paths_exclude_pattern"]):
                archive.write(path, path.relative_to(ROOT).as_posix())
            for wheel in wheels:
                archive.write(wheel, f"wheels/{wheel.name}", zipfile.ZIP_STORED)
        shutil.move(temporary, target)
    return target


def manifest_text(text: str, platform: str, wheels: list[Path]) -> str:
    """Return the manifest's text with platform and wheels before its first table."""
    lines = ["platforms = [" + f'"{platform}"' + "]", "wheels = ["]
    lines += [f'  "./wheels/{wheel.name}",' for wheel in wheels]
    head, table, tail = text.partition("[permissions]")
    if not table:
        raise ValueError("blender_manifest.toml has no [permissions] table")
    tail = tail.partition("[build]")[0]  # concerns building only
    return head + "\n".join([*lines, "]"]) + "\n\n" + table + tail.rstrip() + "\n"


def content(patterns: list[str]) -> list[Path]:
    """Return the files that belong into the archive: tracked or not, less the manifest's exclude patterns."""
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
    """Whether a pattern in the style of .gitignore names this path (a leading / ties it to the root)."""
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
    """Let Blender's own tool check the archive."""
    subprocess.run([blender, "--factory-startup", "--command", "extension", "validate", str(archive)], check=True)


if __name__ == "__main__":
    sys.exit(main())
