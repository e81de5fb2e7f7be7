"""README.md and docs: commands, scripts, quotations and drawings are those of the code."""

import re
import tomllib
from pathlib import Path
from urllib.parse import urlsplit

import make_drawings
import numpy as np
import perfanim
import pytest
from document_commands import DOCUMENTS, Command, blocks, commands, make_targets, parse_problem
from manual_pages import anchor
from perfanim.core.markers.marker_set import PointKind, load_marker_set, marker_set_names
from PIL import Image

ROOT = Path(perfanim.__file__).parent
FRONT = tuple(ROOT / name for name in ("CONTRIBUTING.md", "SECURITY.md", "CHANGELOG.md"))
COMMANDS = [command for document in DOCUMENTS for command in commands(document)]


def test_documents_have_commands():
    assert {command.where.partition(":")[0] for command in COMMANDS} >= {
        "README.md", "docs/calibration.md", "docs/command-line.md", "docs/export.md", "docs/marker-takes.md"
    }  # fmt: skip
    assert len(COMMANDS) > 80


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_commands_exist(document):
    for command in commands(document):
        if command.words[0] == "make":
            targets = {word for word in command.words[1:] if "=" not in word}
            assert targets <= make_targets(), command.where
        else:
            assert parse_problem(command) == "", f"{command.where}: {command.text}"


@pytest.mark.parametrize(
    ("line", "problem"),
    [
        ("perfanim solve walk.c3d --database m.pfdb --out w.bvh --subjekt a.toml", "unrecognized arguments: --subjekt"),
        ("perfanim solve walk.c3d", "required"),
        ("perfanim sing walk.c3d", "invalid choice"),
    ],
)
def test_wrong_commands_are_found(line, problem):
    assert problem in parse_problem(Command("here:1", tuple(line.split()), in_block=True))


@pytest.mark.parametrize("words", ["perfanim take sing", "perfanim solve ... --uses 9"])
def test_wrong_commands_in_prose_are_found(words):
    assert parse_problem(Command("here:1", tuple(words.split()), in_block=False)).startswith("there is no")


@pytest.mark.parametrize("document", DOCUMENTS, ids=lambda path: path.name)
def test_blocks_can_be_read(document):
    for line, block in blocks(document, "toml"):
        assert tomllib.loads(block), f"{document.name}:{line}"
    for line, block in blocks(document, "python"):
        compile(block, f"{document.name}:{line}", "exec")


@pytest.mark.parametrize("document", (*DOCUMENTS, *FRONT), ids=lambda path: path.name)
def test_addresses_are_whole(document):
    for address in re.findall(r"\]\((\w+:[^)]*)\)", document.read_text(encoding="utf-8")):
        parts = urlsplit(address)
        assert parts.scheme == "https" and "." in parts.netloc, address


@pytest.mark.parametrize("document", (*DOCUMENTS, *FRONT), ids=lambda path: path.name)
def test_links_lead_to_files_and_headings(document):
    """On a repository's page as well: the generator of the pages sees only what lies in docs."""
    text = document.read_text(encoding="utf-8")
    links = [link for link in re.findall(r"\]\(([^)\s]+)\)", text) if not re.match(r"\w+:", link)]
    assert links or document.name not in ("README.md", "CONTRIBUTING.md", "SECURITY.md")
    for link in links:
        page, _, place = link.partition("#")
        target = (document.parent / page).resolve() if page else document
        generated = target.parent == ROOT / "docs" / "api"
        assert generated or (target.is_file() and target.is_relative_to(ROOT)), link
        if place and not generated:
            headings = re.findall(r"^#+ (.+)$", target.read_text(encoding="utf-8"), re.MULTILINE)
            assert place in {anchor(heading) for heading in headings}, link


def test_the_threat_model_is_among_the_pages():
    page = (ROOT / "docs" / "security.md").read_text(encoding="utf-8")
    assert "{include} ../SECURITY.md" in page
    threats = (ROOT / "SECURITY.md").read_text(encoding="utf-8")
    for name in re.findall(r"`((?:core|tests|tools)/[\w/.]+)`", threats):
        assert (ROOT / name).exists(), name
    for target in re.findall(r"`make\s+([\w-]+)", threats):
        assert target in make_targets(), target


def test_the_share_of_right_names_is_that_of_the_films():
    figures = (ROOT / "docs" / "figures.md").read_text(encoding="utf-8")
    films = figures.partition("| film | right |")[2].partition("\n\n")[0]
    shares = [float(share) for share in re.findall(r"\| ([\d.]+) % \|", films)]
    assert len(shares) > 5
    assert f"| {min(shares):g} to {max(shares):g} % |" in (ROOT / "README.md").read_text(encoding="utf-8")


def test_messages_are_those_of_the_program():
    page = (ROOT / "docs" / "when-it-looks-wrong.md").read_text(encoding="utf-8")
    source = "".join(
        path.read_text(encoding="utf-8") for name in ("core", "perfanim_addon") for path in (ROOT / name).rglob("*.py")
    )
    rows = [line.split("|")[1] for line in page.splitlines() if line.startswith('| "')]
    quoted = [message for row in rows for message in re.findall(r'"([^"]+)"', row)]
    assert len(quoted) > 15
    assert [message for message in quoted if message not in source] == []


def test_drawings_are_of_the_present_files():
    assert make_drawings.main(["--check"]) == 0


def test_every_marker_set_that_is_worn_is_shown():
    page = (ROOT / "docs" / "wear-markers.md").read_text(encoding="utf-8")
    drawn = set(re.findall(r"drawings/markers-([\w-]+)\.svg", page))
    assert drawn == {name for name in marker_set_names() if load_marker_set(name).points is PointKind.MARKERS}


def test_every_page_is_in_the_index():
    index = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    pages = {path.stem for path in (ROOT / "docs").glob("*.md")} - {"index"}
    listed = {
        line.strip()
        for block in re.findall(r"```\{toctree\}\n(.*?)```", index, re.DOTALL)
        for line in block.split("\n")
    }
    assert pages <= listed


def test_the_readme_is_short_and_its_pictures_are_small():
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(readme.splitlines()) <= 120
    pictures = [ROOT / address for address in re.findall(r"!\[[^\]]+\]\(([^)]+)\)", readme)]
    assert len(pictures) >= 3
    for picture in pictures:
        assert 10_000 < picture.stat().st_size <= 1_500_000, picture.name


def test_the_moving_picture_moves():
    with Image.open(ROOT / "docs" / "pictures" / "live.webp") as moving:
        assert moving.n_frames > 30
        assert moving.info["loop"] == 0
        first = np.asarray(moving.convert("RGB"), dtype=float)
        moving.seek(moving.n_frames // 2)
        changed = np.abs(np.asarray(moving.convert("RGB"), dtype=float) - first).max(axis=2) > 30.0
    for panel in np.array_split(changed, 3, axis=1):  # camera, skeleton, character
        assert panel.mean() > 0.005
