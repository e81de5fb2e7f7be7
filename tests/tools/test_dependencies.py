"""docs/dependencies.md names each library of pyproject.toml, and the extension ships those that the core needs."""

import re
import tomllib
from pathlib import Path

import perfanim
import pytest
from packaging.requirements import Requirement

ROOT = Path(perfanim.__file__).parent
PAGE = (ROOT / "docs" / "dependencies.md").read_text(encoding="utf-8")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
MANIFEST = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))
WANTED = {
    "": [Requirement(line) for line in PROJECT["dependencies"]],
    **{extra: [Requirement(line) for line in lines] for extra, lines in PROJECT["optional-dependencies"].items()},
}
# where the page uses the library's own name, and the registry another
CALLED = {"opencv-contrib-python-headless": "OpenCV (contrib, headless)", "myst-parser": "MyST"}


def rows(heading: str) -> list[list[str]]:
    """Return the cells of each row of the table below a heading."""
    table = PAGE.partition(f"## {heading}\n")[2].partition("\n## ")[0]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines() if line[:1] == "|"][2:]


def libraries(extra: str) -> str:
    """Return what the page says of an extra's libraries, "" for those at run time."""
    if not extra:
        return "\n".join(row[0] for row in rows("At run time"))
    said, current = [], ""
    for extras, names, _why in rows("For developers"):
        current = extras or current
        if f"`{extra}`" in current:
            said.append(names)
    return "\n".join(said)


@pytest.mark.parametrize("extra", WANTED)
def test_each_library_is_on_the_page(extra):
    said = libraries(extra).lower()
    for requirement in WANTED[extra]:
        name = CALLED.get(requirement.name, requirement.name).lower()
        assert re.search(rf"(?<![\w-]){re.escape(name)}(?![\w-])", said), f"{extra}: {requirement.name}"


def test_each_library_on_the_page_is_asked_for():
    called = {CALLED.get(wanted.name, wanted.name).lower() for wanted in WANTED[""]}
    assert {row[0].lower() for row in rows("At run time")} == called
    extras = {name for row in rows("For developers") for name in re.findall(r"`([\w-]+)`", row[0])}
    assert extras == set(WANTED) - {""}


def test_each_has_a_reason():
    for row in (*rows("At run time"), *rows("For developers")):
        assert len(row) == 3 and len(row[2]) > 10, row


def test_the_extension_ships_what_the_core_needs():
    lines = (ROOT / "tools" / "wheels.txt").read_text(encoding="utf-8").splitlines()
    pinned = {line.partition("==")[0]: line.partition("==")[2] for line in lines if "==" in line}
    assert set(pinned) == {wanted.name for wanted in WANTED[""]} - {"numpy"}  # numpy is Blender's own
    for wanted in WANTED[""]:
        assert wanted.name == "numpy" or wanted.specifier.contains(pinned[wanted.name]), wanted


def test_manifest_and_project_agree():
    assert MANIFEST["license"] == [f"SPDX:{PROJECT['license']}"]
    assert MANIFEST["id"] == PROJECT["name"]
    assert "wheels" not in MANIFEST  # filled in by the build, for each platform
    assert "1.24 (Blender 4.2)" in PAGE and MANIFEST["blender_version_min"] == "4.2.0"
