"""Run the commands and scripts of these pages (`make docs`), each in a folder with the files that they name."""

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).parents[1] / "tests" / "helpers"))

from document_commands import read_command
from document_inputs import make_inputs
from sybil import Example, Sybil
from sybil.parsers.markdown import CodeBlockParser, PythonCodeBlockParser

# first words of a command -> why it is not run; its arguments are parsed all the same (tests/tools/test_documents.py)
LEFT_OUT = {
    "perfanim calibrate cameras --camera a=a.mp4": "needs videos of a ChArUco board by three cameras",
    "perfanim calibrate cameras --by-": "needs videos of a person, or of waved markers",
    "perfanim network get": "needs the internet; the tests of the network have its file",
    "perfanim track --cameras cameras.toml --left left.mp4 --right right.mp4 --people": "needs videos of a person",
    "perfanim track --cameras cameras.toml --left left.mp4 --people": "needs a video of a person",
    "perfanim solve walk.take.npz --out walk.bvh": "needs such a take",
    "perfanim solve walk.take.npz --height": "needs such a take",
    "perfanim calibrate floor": "needs a recording of markers that lie on the floor",
    "perfanim batch plan.toml": "needs the plan of the page and its folders; the tests of batches run plans",
    "perfanim sketch dance.blend": "needs a file with controls; the tests of the sample solve one",
    "perfanim vmc send walk.perftake --to 192.168": "another computer of the reader's network",
    "perfanim vmc receive": "needs a sender; the tests of VMC have one",
}
_LONGEST_S = 600


def _perfanim(folder: Path, *words: str) -> None:
    command = [sys.executable, "-m", "perfanim.core.cli.main", *words]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=_LONGEST_S)
    if done.returncode:
        pytest.fail(f"perfanim {' '.join(words)}: {done.stderr.strip() or done.stdout.strip()}", pytrace=False)


@pytest.fixture(scope="session")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of all files that the pages name."""
    folder = tmp_path_factory.mktemp("inputs")
    make_inputs(folder, lambda *words: _perfanim(folder, *words), with_videos=True)
    return folder


@pytest.fixture
def folder(inputs: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Fresh copy of these files, in which a script runs."""
    place = tmp_path / "place"
    shutil.copytree(inputs, place)
    monkeypatch.chdir(place)
    return place


def _run_commands(example: Example) -> None:
    for line in example.parsed.splitlines():
        for command in read_command(example.path, line, in_block=True):
            is_run = command.words[0] == "perfanim" and not command.is_template
            if is_run and not any(command.text.startswith(start) for start in LEFT_OUT):
                with tempfile.TemporaryDirectory() as place:  # no command sees what another has written
                    shutil.copytree(example.namespace["inputs"], place, dirs_exist_ok=True)
                    _perfanim(Path(place), *command.words[1:])


pytest_collect_file = Sybil(
    parsers=[CodeBlockParser(language="sh", evaluator=_run_commands), PythonCodeBlockParser()],
    pattern="*.md",
    fixtures=["inputs", "folder"],
).pytest()
