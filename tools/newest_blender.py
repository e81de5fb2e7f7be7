"""Fetch the wheel of the newest Blender as a Python module: the last release, or today's build of its main branch.

For the workflow that tests the add-on with Blenders to come. A daily build is a zip with one wheel, listed as JSON by
Blender's build server; releases are wheels on Blender's own package index.
"""

import argparse
import io
import json
import re
import subprocess
import sys
import urllib.request
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

DAILY = "https://builder.blender.org/download/bpy/?format=json&v=1"
RELEASES = "https://download.blender.org/pypi/"
PLATFORM, MACHINE = "linux", "x86_64"


def newest_build(builds: Sequence[Mapping[str, Any]]) -> Mapping[str, Any]:
    """Return the newest build for Linux with the highest version; ValueError if there is none."""
    fitting = [
        build
        for build in builds
        if (build["platform"], build["architecture"]) == (PLATFORM, MACHINE) and build["file_extension"] == "zip"
    ]
    if not fitting:
        raise ValueError(f"{DAILY} lists no build for {PLATFORM} {MACHINE}; look whether its form has changed")
    return max(fitting, key=lambda build: (_version(str(build["version"])), build["file_mtime"]))


def unpack_wheel(content: bytes, folder: Path) -> Path:
    """Write the wheel in a zip to a folder, under a name that pip accepts, and return its path."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith(".whl"))
        path = folder / Path(name).name
        path.write_bytes(archive.read(name))
    return path


def _version(text: str) -> tuple[int, ...]:
    return tuple(map(int, re.findall(r"\d+", text)[:3]))


def _read(address: str) -> bytes:
    with urllib.request.urlopen(address, timeout=120) as answer:  # noqa: S310 - addresses of this file and that server
        return bytes(answer.read())


def main() -> None:
    """Put the wheel into the folder."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("which", choices=("release", "daily"))
    parser.add_argument("--to", type=Path, required=True)
    args = parser.parse_args()
    args.to.mkdir(parents=True, exist_ok=True)
    if args.which == "daily":
        build = newest_build(json.loads(_read(DAILY)))
        unpack_wheel(_read(str(build["url"])), args.to)
    else:
        line = [sys.executable, "-m", "pip", "download", "--no-deps", "--dest", str(args.to)]
        subprocess.run([*line, "--extra-index-url", RELEASES, "bpy"], check=True)


if __name__ == "__main__":
    main()
