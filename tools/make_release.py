"""Make a release: all archives, their checksums, and notes from the changelog.

    python tools/make_release.py [--out DIR] [--wheels DIR]

It prints the contents of each archive by size. It fails before any work if versions differ or the changelog has no
section for this version.
"""

import argparse
import hashlib
import re
import sys
import tomllib
import zipfile
from collections import Counter
from pathlib import Path

from build_extension import PLATFORMS, ROOT, build, download_wheels
from perfanim.core import __version__

CHECKSUMS, NOTES = "SHA256SUMS", "release-notes.md"
_SHOWN = 12  # number of an archive's largest parts that are printed


def check_version() -> None:
    """Compare the manifest's version with the package's.

    Raises:
        ValueError: The versions differ.
    """
    manifest = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))["version"]
    if manifest != __version__:
        raise ValueError(f"blender_manifest.toml has version {manifest}, core/__init__.py {__version__}")


def release_notes(changelog: str, version: str) -> str:
    """Return the changelog section for a version.

    Raises:
        ValueError: The section is missing or empty.
    """
    found = re.search(rf"^## {re.escape(version)}(?: [^\n]*)?\n(.*?)(?=^## |\Z)", changelog, re.MULTILINE | re.DOTALL)
    if not found or not found[1].strip():
        raise ValueError(f"CHANGELOG.md has no section {version}")
    return found[1].strip() + "\n"


def sizes(archive: Path) -> Counter[str]:
    """Return the stored bytes of each wheel and each second-level folder."""
    found: Counter[str] = Counter()
    with zipfile.ZipFile(archive) as content:
        for entry in content.infolist():
            folders = Path(entry.filename).parts
            is_wheel = folders[0] == "wheels"
            found[entry.filename if is_wheel else "/".join(folders[: min(2, len(folders) - 1)]) or "(top level)"] += (
                entry.compress_size
            )
    return found


def size_table(archive: Path) -> str:
    """Return an archive's size and its largest parts, one line each."""
    parts = sizes(archive)
    rows = [f"  {count / 1e6:8.2f} MB  {name}" for name, count in parts.most_common(_SHOWN)]
    rest = sum(parts.values()) - sum(count for _, count in parts.most_common(_SHOWN))
    rows.append(f"  {rest / 1e6:8.2f} MB  all else")
    return "\n".join([f"{archive.name}: {archive.stat().st_size / 1e6:.2f} MB", *rows]) + "\n"


def make_release(out: Path, wheels: Path) -> list[Path]:
    """Build all archives with checksums and notes; return the archives."""
    check_version()
    notes = release_notes((ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), __version__)
    out.mkdir(parents=True, exist_ok=True)
    for old in (*out.glob("*.zip"), out / CHECKSUMS, out / NOTES):
        old.unlink(missing_ok=True)
    archives = [build(platform, download_wheels(platform, wheels), out) for platform in PLATFORMS]
    lines = [f"{hashlib.sha256(archive.read_bytes()).hexdigest()}  {archive.name}\n" for archive in archives]
    (out / CHECKSUMS).write_text("".join(lines), encoding="utf-8")
    (out / NOTES).write_text(notes, encoding="utf-8")
    return archives


def main() -> int:
    """Make the release and print sizes; return the exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=ROOT / "dist", help="folder for everything (default dist)")
    parser.add_argument("--wheels", type=Path, help="folder that keeps downloaded wheels (default OUT/wheels)")
    options = parser.parse_args()
    try:
        archives = make_release(options.out, options.wheels or options.out / "wheels")
    except ValueError as error:
        sys.stderr.write(f"{error}\n")
        return 1
    for archive in archives:
        sys.stdout.write(size_table(archive))
    return 0


if __name__ == "__main__":
    sys.exit(main())
