"""Run the commands and Python scripts of README.md and docs/.

Each runs in a folder with the files that they name.

    python tools/run_documents.py [--cheap]

Every command on a line of its own is run as it stands, in a fresh copy of the folder; exceptions are listed in
`LEFT_OUT` with the reason. `--cheap` runs the first of each kind that needs neither videos nor Blender.
"""

import argparse
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from documents.commands import DOCUMENTS, ROOT, Command, blocks, commands
from documents.inputs import make_inputs

# first words of a command -> why it is not run; its arguments are parsed all the same
LEFT_OUT = {
    "perfanim calibrate cameras --camera a=a.mp4": "needs videos of a ChArUco board by three cameras",
    "perfanim calibrate floor": "needs a recording of markers that lie on the floor",
    "perfanim batch plan.toml": "needs the plan of the page and its folders; the tests of batches run plans",
    "perfanim sketch dance.blend": "needs a file with controls; the tests of the sample solve one",
    "perfanim vmc send walk.perftake --to 192.168": "another computer of the reader's network",
    "perfanim vmc receive": "needs a sender; the tests of VMC have one",
}
DEAR = ("left.mp4", "board/", "character.glb", "hero.glb", "perfanim simulate cameras", "perfanim database build")
_LONGEST_S = 600


def chosen(cheap: bool) -> Iterator[Command]:
    """Yield the commands to run: those on lines of their own, each once."""
    seen = set()
    for document in DOCUMENTS:
        for command in commands(document):
            text = " ".join(command.words)
            if not command.in_block or command.words[0] != "perfanim" or command.is_template:
                continue
            if any(text.startswith(start) for start in LEFT_OUT) or (cheap and any(dear in text for dear in DEAR)):
                continue
            kind = " ".join(word for word in command.words[:3] if word.isalpha()) if cheap else text
            if kind not in seen:
                seen.add(kind)
                yield command


def run(folder: Path, *words: str) -> str:
    """Run a perfanim command in a folder; return its error message, "" for none."""
    command = [sys.executable, "-m", "perfanim.core.cli.main", *words]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=_LONGEST_S)
    return "" if done.returncode == 0 else (done.stderr.strip() or done.stdout.strip() or f"exit {done.returncode}")


def run_scripts(folder: Path) -> Iterator[str]:
    """Run the Python blocks of each document one after another; yield failures."""
    for document in DOCUMENTS:
        for line, script in blocks(document, "python"):
            done = subprocess.run([sys.executable, "-c", script], cwd=folder, capture_output=True, text=True)
            if done.returncode:
                yield f"{document.relative_to(ROOT).as_posix()}:{line}: {done.stderr.strip().splitlines()[-1]}"


def run_all(folder: Path, cheap: bool) -> Iterator[str]:
    """Run everything, each command in a copy of the inputs; yield failures."""
    inputs = folder / "inputs"
    inputs.mkdir()

    def prepare(*words: str) -> None:
        if problem := run(inputs, *words):
            raise RuntimeError(f"perfanim {' '.join(words)}: {problem}")

    make_inputs(inputs, prepare, not cheap)
    for number, command in enumerate(chosen(cheap)):
        place = folder / str(number)
        shutil.copytree(inputs, place)
        if problem := run(place, *command.words[1:]):
            yield f"{command.where}: {command.text}\n    {problem}"
        shutil.rmtree(place)
    if not cheap:  # tests/core/test_scripting.py runs them as well
        yield from run_scripts(inputs)


def main() -> int:
    """Run the commands; return 1 if any failed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--cheap", action="store_true", help="some, without videos and Blender")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        problems = list(run_all(Path(folder), options.cheap))
    sys.stdout.write("".join(f"{problem}\n" for problem in problems))
    sys.stdout.write(f"{len(list(chosen(options.cheap)))} commands, {len(problems)} failed\n")
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
