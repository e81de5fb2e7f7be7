"""Hold files, functions and classes to the largest sizes that the project allows.

Usage: python tools/check_sizes.py [PATH...]; exit status 1 and one line per finding.
ruff holds parameters and complexity.
"""

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
FILE_LINES = 400
FUNCTION_LINES = 60
CLASS_LINES = 200
# core/ and perfanim_addon/ together: 45,000 for what the package could do when it was rebuilt, the rest for what came
# later (offline solving in both directions, noise estimation, the prior in use, sketches and
# their panel: 4,000 and a package; the guide for cameras, with its check of the pictures, recordings of one's own that
# count before those of others, refusals of inputs that fuzzers found, and fewer and larger steps of a frame: 900; what
# random steps in a window and guided fuzzing found, that is files of killed workers, names that no file can have,
# messages of one line: 50; poses without noise and hidden hands that come back: 250; places to ignore in pictures, the
# common space in the viewport, the walk test, cameras by name, and panels that grow: 700; feet of sketches that stand
# and step as all examples of them do, and live edits of their paths: 300; schemas of files with units and ranges, from
# which errors and the manual's page come: 200; limits of small files that take much, requests and motion that are
# checked: 500; streams that are watched as cameras are, outputs that are no inputs and have one writer, leftovers that
# go at the start: 420; drawn curves and paths of sketches, and their list of behaviours: 250; choice of rates, several
# subjects, archives checked when they come: 100; arrays of a frame handled together, and errors of joints: 200; joints
# that neighbours of other people are doubted in, and directions of the main bones: 50; schemas of plans, maps, names,
# collections and databases' facts: 200; cameras by network address, and names of markers that do not overlap: 150;
# priors known beforehand, folders of plans: 100; performers refined by a take, in the panel and while solving, with how
# sure each change is: 420; fits of many frames at once, and the low-pass filter itself: 90; rough rigs
# as controls of sketches, steps between far keys: 280; markers of one camera in the learned prior: 40; markers that are
# hidden for a moment, limbs hidden altogether, refinement while capturing, reflections by number: 180; medians of many
# clips at once, limbs of sketches without keys: 60; records of batches, facts of takes, lists of archives and
# beginnings of films that are checked before they are believed: 280; cells of a database that one search serves all
# sizes by, in place of bounds: 80; decimals read eight digits at a time, hierarchies and bones of files computed once
# or together: 340; columns of pictures that changed, and pairs of blobs compared alone: 80).
TOTAL_LINES = 57_320
ENTRIES = {"core": 18, "perfanim_addon": 14}
# "path:name" -> reason
ALLOWED: dict[str, str] = {}


def findings_of(path: Path) -> Iterator[str]:
    """Yield a line for each class and function, or the whole module, if too long."""
    source = path.read_text(encoding="utf-8")
    place = path.resolve().relative_to(ROOT).as_posix()
    if source.count("\n") > FILE_LINES:
        yield f"{place}: {source.count(chr(10))} lines, {FILE_LINES} at most: split it by subject"
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.FunctionDef | ast.ClassDef) or f"{place}:{node.name}" in ALLOWED:
            continue
        lines, limit = (node.end_lineno or 0) - node.lineno + 1, CLASS_LINES
        if isinstance(node, ast.FunctionDef):
            limit = FUNCTION_LINES
        if lines > limit:
            yield f"{place}:{node.lineno}: {node.name} has {lines} lines, {limit} at most"


def main(arguments: list[str]) -> int:
    """Print the findings below the paths, the package by default; return 1 if any."""
    paths = [Path(path) for path in arguments] or [ROOT / name for name in (*ENTRIES, "tools")]
    files = sorted(file for path in paths for file in ([path] if path.is_file() else path.rglob("*.py")))
    findings = [line for file in files for line in findings_of(file)]
    if not arguments:
        lines = sum(
            file.read_text(encoding="utf-8").count("\n") for name in ENTRIES for file in (ROOT / name).rglob("*.py")
        )
        if lines > TOTAL_LINES:
            rise = "raise TOTAL_LINES in tools/check_sizes.py and say there why"
            findings.append(f"core and perfanim_addon have {lines} lines, {TOTAL_LINES} at most: {rise}")
        for name, most in ENTRIES.items():
            entries = [entry for entry in (ROOT / name).iterdir() if entry.name != "__pycache__"]
            if len(entries) > most:
                findings.append(f"{name} has {len(entries)} entries at its top level, {most} at most")
    sys.stdout.write("".join(f"{line}\n" for line in findings))
    return 1 if findings else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
