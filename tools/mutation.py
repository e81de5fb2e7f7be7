"""Measure the share of small changes of the code that its tests notice.

    python tools/mutation.py [--out DIR] [--tests PATH...] [--share S] [--seed N] MODULE_OR_FOLDER...

cosmic-ray changes one operator, number or condition at a time in a copy of the package, and runs the tests that mirror
the module (or --tests) until one fails. Survivors are listed; `OUT/survivors.txt` shows each as a difference. All
changes take days: with --share a part of each module's is drawn by chance, which is enough for a percentage.
"""

import argparse
import ast
import math
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TypeAlias

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
_COPIED = ("core", "assets", "tests", "tools", "__init__.py", "pyproject.toml", "README.md", "docs")
_SLOWER = 5.0  # than without a change: then a changed loop does not end
_LEAST_S = 20.0

Span: TypeAlias = tuple[tuple[int, int], tuple[int, int]]  # two lines and columns


def copy_package(out: Path) -> Path:
    """Return a folder with a copy of the package, to be changed."""
    place = out / "copy"
    shutil.rmtree(place, ignore_errors=True)
    for name in _COPIED:
        source, target = ROOT / name, place / "perfanim" / name
        if source.is_dir():
            shutil.copytree(source, target, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(source, target)
    return place


def tests_of(module: str) -> list[str]:
    """Return the tests that mirror a module: its own file, else its folder's."""
    path = ROOT / "tests" / Path(module)
    own = path.with_name(f"test_{path.stem}.py")
    folder = path if path.is_dir() else path.parent
    return [(own if own.is_file() else folder).relative_to(ROOT).as_posix()]


def modules_of(names: list[str]) -> Iterator[str]:
    """Yield modules, those of folders one by one."""
    for name in names:
        path = ROOT / name
        for file in sorted(path.rglob("*.py")) if path.is_dir() else [path]:
            if file.name != "__init__.py":
                yield file.relative_to(ROOT).as_posix()


def mutate(
    place: Path, out: Path, module: str, tests: list[str], seconds: float, share: float, chance: np.random.Generator
) -> Path:
    """Run a share of the changes of a module; return the session's file."""
    name = module.removesuffix(".py").replace("/", "-")
    config, session = out / f"{name}.toml", out / f"{name}.sqlite"
    session.unlink(missing_ok=True)
    command = f"{sys.executable} -m pytest -q -x -p no:cacheprovider {' '.join(f'perfanim/{test}' for test in tests)}"
    config.write_text(
        f'[cosmic-ray]\nmodule-path = "perfanim/{module}"\ntimeout = {seconds:.1f}\nexcluded-modules = []\n'
        f'test-command = "{command}"\n[cosmic-ray.distributor]\nname = "local"\n',
        encoding="utf-8",
    )
    command_line = [sys.executable, "-m", "cosmic_ray.cli"]
    environment = {**os.environ, "PYTHONPATH": str(place)}
    subprocess.run([*command_line, "init", str(config), str(session)], cwd=place, check=True, env=environment)
    keep_share(session, annotations_of(ROOT / module), share, chance)
    subprocess.run([*command_line, "exec", str(config), str(session)], cwd=place, check=True, env=environment)
    return session


def annotations_of(module: Path) -> list[Span]:
    """Return where a module's annotations begin and end."""
    nodes = list(ast.walk(ast.parse(module.read_text(encoding="utf-8"))))
    annotations = [node.annotation for node in nodes if isinstance(node, ast.arg | ast.AnnAssign)]
    annotations += [node.returns for node in nodes if isinstance(node, ast.FunctionDef)]
    return [
        ((node.lineno, node.col_offset), (node.end_lineno or 0, node.end_col_offset or 0))
        for node in annotations
        if node is not None
    ]


def keep_share(session: Path, annotations: list[Span], share: float, chance: np.random.Generator) -> None:
    """Keep so many of a session's changes outside annotations, drawn by chance.

    A changed annotation fails at import, whatever is tested.
    """
    from cosmic_ray.work_db import WorkDB, use_db

    with use_db(session, WorkDB.Mode.open) as database:
        changes = [
            item
            for item in sorted(database.work_items, key=lambda item: str(item.mutations))  # their ids are new each time
            if not any(begin <= mutation.start_pos <= end for mutation in item.mutations for begin, end in annotations)
        ]
        database.clear()
        drawn = chance.permutation(len(changes))[: math.ceil(share * len(changes))]
        database.add_work_items([changes[index] for index in drawn])


def time_tests(place: Path, tests: list[str]) -> float:
    """Return how long the tests take without a change, seconds.

    Raises:
        subprocess.CalledProcessError: they fail.
    """
    arguments = ["-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *(f"perfanim/{test}" for test in tests)]
    before = os.times()
    environment = {**os.environ, "PYTHONPATH": str(place)}
    subprocess.run([sys.executable, *arguments], cwd=place, check=True, env=environment, stdout=subprocess.DEVNULL)
    return os.times().elapsed - before.elapsed


def outcomes_of(session: Path) -> tuple[int, list[str]]:
    """Return the number of changes of a session, and the differences of survivors."""
    from cosmic_ray.work_db import WorkDB, use_db  # in an environment of its own
    from cosmic_ray.work_item import TestOutcome

    with use_db(session, WorkDB.Mode.open) as database:
        results = [result for _, result in database.results]
    return len(results), [str(result.diff) for result in results if result.test_outcome is TestOutcome.SURVIVED]


def main() -> int:
    """Print killed and surviving changes of each module; return the exit status."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("modules", nargs="+", metavar="MODULE_OR_FOLDER", help="such as core/geometry/two_bone_ik.py")
    parser.add_argument(
        "--tests", nargs="+", metavar="PATH", help="tests to run (default: those that mirror the module)"
    )
    parser.add_argument("--share", type=float, default=1.0, metavar="S", help="of each module's changes, 0 to 1")
    parser.add_argument("--seed", type=int, default=1, metavar="N", help="of the chance that draws them")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "mutation", help="folder for the results")
    options = parser.parse_args()
    out = options.out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    place, chance = copy_package(out), np.random.default_rng(options.seed)
    killed = total = 0
    survivors = []
    for module in modules_of(options.modules):
        tests = options.tests or tests_of(module)
        seconds = max(_LEAST_S, _SLOWER * time_tests(place, tests))
        count, alive = outcomes_of(mutate(place, out, module, tests, seconds, options.share, chance))
        survivors += [f"{module}\n{difference}\n" for difference in alive]
        killed, total = killed + count - len(alive), total + count
        sys.stdout.write(f"{module}: {count - len(alive)} of {count} changes noticed\n")
        sys.stdout.flush()
    (out / "survivors.txt").write_text("\n".join(survivors), encoding="utf-8")
    share = f" ({killed / total:.1%})" if total else ""
    sys.stdout.write(f"all: {killed} of {total}{share}; survivors in {out / 'survivors.txt'}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
