"""Measure the share of small changes of the code that its tests notice.

    python tools/mutation.py [--out DIR] [--tests PATH...] MODULE_OR_FOLDER...

cosmic-ray changes one operator, number or condition at a time in a copy of the package, and runs the tests that mirror
the module (or --tests) until one fails. Survivors are listed; `OUT/survivors.txt` shows each as a difference.
"""

import argparse
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
_COPIED = ("core", "assets", "tests", "tools", "__init__.py", "pyproject.toml", "README.md", "docs")
_SLOWER = 5.0  # than without a change: then a changed loop does not end
_LEAST_S = 20.0


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


def mutate(place: Path, out: Path, module: str, tests: list[str], seconds: float) -> Path:
    """Run all changes of a module; return the session's file."""
    name = module.removesuffix(".py").replace("/", "-")
    config, session = out / f"{name}.toml", out / f"{name}.sqlite"
    session.unlink(missing_ok=True)
    command = f"{sys.executable} -m pytest -q -x -p no:cacheprovider {' '.join(f'perfanim/{test}' for test in tests)}"
    config.write_text(
        f'[cosmic-ray]\nmodule-path = "perfanim/{module}"\ntimeout = {seconds:.1f}\nexcluded-modules = []\n'
        f'test-command = "{command}"\n[cosmic-ray.distributor]\nname = "local"\n',
        encoding="utf-8",
    )
    environment = {**os.environ, "PYTHONPATH": str(place)}
    for step in ("init", "exec"):
        arguments = ["-m", "cosmic_ray.cli", step, str(config), str(session)]
        subprocess.run([sys.executable, *arguments], cwd=place, check=True, env=environment)
    return session


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
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "mutation", help="folder for the results")
    options = parser.parse_args()
    out = options.out.resolve()
    out.mkdir(parents=True, exist_ok=True)
    place = copy_package(out)
    killed = total = 0
    survivors = []
    for module in modules_of(options.modules):
        tests = options.tests or tests_of(module)
        seconds = max(_LEAST_S, _SLOWER * time_tests(place, tests))
        count, alive = outcomes_of(mutate(place, out, module, tests, seconds))
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
