"""Developer: a new marker file format by docs/architecture.md alone, in a copy."""

import difflib
import re
import shutil
import subprocess
from pathlib import Path

from .page import ROOT, Walk, WalkError

_PARTS = Path(__file__).resolve().parent / "new_format"
_SAMPLE = "M\nnRows=2\nendheader\ntime\tA_tx\tA_ty\tA_tz\n0\t1\t2\t3\n0.01\t1\t2\t3\n"
_TESTS = "tests/core/formats/markers/test_marker_files.py"
_LIST = "core/formats/markers/marker_files.py"
_DOORS = "tools/fuzz/doors.py"
_SIZES = "tools/check_sizes.py"
_BULLETS = ("Any reader of foreign input", "Marker file format")


def walk_through(folder: Path) -> None:
    """Add OpenSim's storage files as a format, step by step, each as the page says.

    Raises:
        WalkError: a step did not end as the page says.
    """
    walk = Walk("Developer: a new marker file format", folder, {"PYTHONPATH": str(folder)})
    copy = folder / "perfanim"
    walk.step("A copy of the repository")
    _copy_repository(copy)
    walk.step("What the page says", "docs/architecture.md, How to add")
    walk.note("\n\n".join(_bullet(name) for name in _BULLETS))
    walk.step("The test first", "It must fail without the change.")
    _change(walk, copy / _TESTS, "", (_PARTS / "sto_tests.txt").read_text(encoding="utf-8"))
    only = ("-m", "pytest", _TESTS, "-q", "-p", "no:cacheprovider", "--no-header", "-k", "storage")
    walk.run("python", *only, at=copy, status=1)
    walk.step("A reader beside its like, made with make_take")
    reader = (_PARTS / "sto_reader.txt").read_text(encoding="utf-8")
    (copy / "core/formats/markers/opensim_sto.py").write_text(reader, encoding="utf-8")
    walk.note(reader)
    walk.step("A line in the list of formats")
    _change(walk, copy / _LIST, "from . import c3d, ", "from . import c3d, opensim_sto, ")
    _change(walk, copy / _LIST, "from .qualisys_tsv", "from .opensim_sto import read_sto\nfrom .qualisys_tsv")
    line = '    ".sto": _Format(read_sto, opensim_sto.declared_frames),\n    ".take.npz"'
    _change(walk, copy / _LIST, '    ".take.npz"', line)
    walk.run("python", *only, at=copy)
    walk.step("A door of the fuzzer, and a tiny file for it")
    row = '        ("OpenSim storage", "*.sto", ".sto", change_text, read_markers),\n        ("C3D", '
    _change(walk, copy / _DOORS, '        ("C3D", ', row)
    (copy / "tests/fuzz/corpus/walk.sto").write_text(_SAMPLE, encoding="utf-8")
    door = ("-m", "fuzz", "--door", "OpenSim storage", "--inputs", "200", "--seed", "1", "--out", folder / "fuzz")
    walk.run("python", *door, at=copy / "tools")
    walk.step("Its page, and a line for users")
    _change(walk, copy / "docs/marker-takes.md", "C3D, TRC, Motive's", "C3D, TRC, OpenSim's storage files, Motive's")
    _change(
        walk,
        copy / "CHANGELOG.md",
        "- Marker takes of other systems: C3D,",
        "- Marker takes of other systems: C3D, STO,",
    )
    walk.step("The checks", "The limit of lines is raised with its reason, and the picture of the imports drawn again.")
    _check(walk, copy)
    walk.step("It is there", "Commands and file browsers have the new ending.")
    walk.run("perfanim", "take", "info", "tests/fuzz/corpus/walk.sto", at=copy)
    if ".sto" not in walk.run("perfanim", "solve", "--help", at=copy):
        raise WalkError("perfanim solve does not name the new ending")


def _copy_repository(copy: Path) -> None:
    """Copy the files that git knows, and new ones that it does not ignore."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True, encoding="utf-8").stdout
    for name in filter(None, listed.split("\0")):
        if (ROOT / name).is_file():
            (copy / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, copy / name)


def _bullet(name: str) -> str:
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    found = re.search(rf"^- \*\*{re.escape(name)}\*\*.*?(?=^- |\Z)", page, re.MULTILINE | re.DOTALL)
    if found is None:
        raise WalkError(f"docs/architecture.md does not say how to add: {name}")
    return found[0].rstrip()


def _change(walk: Walk, path: Path, old: str, new: str) -> None:
    """Replace a text that stands once, "" for the file's end, and show both."""
    before = path.read_text(encoding="utf-8")
    if old and before.count(old) != 1:
        raise WalkError(f"{path.name} has {before.count(old)} places with {old!r}")
    after = before.replace(old, new) if old else before + new
    path.write_text(after, encoding="utf-8")
    name = path.relative_to(walk.folder).as_posix()
    lines = difflib.unified_diff(before.splitlines(), after.splitlines(), name, name, lineterm="", n=1)
    walk.note("\n".join(lines))


def _check(walk: Walk, copy: Path) -> None:
    """Run the parts of `make check` that a new format can break, and mend them."""
    changed = ("core/formats/markers", "tests/core/formats/markers", "tools/fuzz")
    walk.run("python", "-m", "ruff", "check", "--no-cache", *changed, at=copy)
    walk.run("python", "-m", "ruff", "format", "--no-cache", "--check", *changed, at=copy)
    walk.run("python", "tools/check_prose.py", at=copy)
    sizes = (copy / _SIZES).read_text(encoding="utf-8")
    limit = re.search(r"^TOTAL_LINES = ([\d_]+)$", sizes, re.MULTILINE)
    if limit is None:
        raise WalkError(f"{_SIZES} has no TOTAL_LINES")
    raised = f"{int(limit[1]) + 100:_}"
    _change(walk, copy / _SIZES, f").\n{limit[0]}", f"; OpenSim's storage files: 100).\nTOTAL_LINES = {raised}")
    walk.run("python", "tools/check_sizes.py", at=copy)
    walk.run("python", "tools/architecture_picture.py", at=copy)
    walk.run("python", "tools/architecture_picture.py", "--check", at=copy)
    tests = ("tests/core/test_architecture.py", "tests/core/test_imports.py", _TESTS)
    walk.run("python", "-m", "pytest", *tests, "-q", "-p", "no:cacheprovider", "--no-header", at=copy)
