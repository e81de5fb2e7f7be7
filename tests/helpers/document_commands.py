"""Commands in README.md and docs/*.md, as a reader would copy them."""

import argparse
import re
import shlex
from collections.abc import Iterator
from contextlib import redirect_stderr
from dataclasses import dataclass
from io import StringIO
from itertools import product
from pathlib import Path

from perfanim.core.cli.main import COMMANDS, build_parser

ROOT = Path(__file__).resolve().parents[2]
DOCUMENTS = (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))
PROGRAMS = ("perfanim", "make")

_FENCE = re.compile(r"^(\s*)```(\S*)\n(.*?)^\s*```", re.MULTILINE | re.DOTALL)
_CODE = re.compile(r"`([^`]+)`")


@dataclass(frozen=True)
class Command:
    """A command of a document.

    Args:
        where: "docs/export.md:7".
        words: program and arguments; without comment, and with one of several alternatives.
        in_block: it stands on a line of its own, whole, for readers to copy.
    """

    where: str
    words: tuple[str, ...]
    in_block: bool

    @property
    def is_template(self) -> bool:
        """Whether readers fill parts in: dots, or words in capitals such as DIR."""
        return any(word == "..." or re.fullmatch(r"[A-Z]{3,}|\.\.\.|[A-Z]+=.*\.\.\.", word) for word in self.words)

    @property
    def text(self) -> str:
        """The command as one line."""
        return shlex.join(self.words)


def blocks(document: Path, language: str) -> list[tuple[int, str]]:
    """Return line number and text of each fenced block in a language."""
    text = document.read_text(encoding="utf-8")
    found = _FENCE.finditer(text)
    return [(text.count("\n", 0, block.start()) + 2, block[3]) for block in found if block[2] == language]


def commands(document: Path) -> Iterator[Command]:
    """Yield the commands of a document: lines of blocks, and code in backticks."""
    name = document.relative_to(ROOT).as_posix()
    text = document.read_text(encoding="utf-8")
    for first, block in blocks(document, "sh"):
        for number, line in enumerate(block.splitlines(), start=first):
            yield from read_command(f"{name}:{number}", line, in_block=True)
    prose = _FENCE.sub(lambda block: "\n" * block[0].count("\n"), text)
    for code in _CODE.finditer(prose):
        number = prose.count("\n", 0, code.start()) + 1
        yield from read_command(f"{name}:{number}", " ".join(code[1].split()), in_block=False)


def read_command(where: str, line: str, in_block: bool) -> Iterator[Command]:
    """Yield the commands of a line, one for each of several alternatives."""
    line = line.strip().removeprefix(".venv/bin/")
    if line.split(" ")[0] not in PROGRAMS:
        return
    try:
        words = shlex.split(line, comments=True)
    except ValueError as error:
        raise ValueError(f"{where}: {line}: {error}") from error
    choices = [word.split("|") if re.fullmatch(r"[\w-]+(\|[\w-]+)+", word) else [word] for word in words]
    for choice in product(*choices):
        yield Command(where, choice, in_block)


def parse_problem(command: Command) -> str:
    """Return why `perfanim` would refuse a command's arguments, "" if it takes them.

    Of templates and of code in prose, which leaves arguments out, only the names of commands and options are checked.
    """
    arguments = list(command.words[1:])
    parser = build_parser(arguments[:1] if set(arguments[:1]) & set(COMMANDS) else COMMANDS)
    if command.in_block and not command.is_template:
        said = StringIO()
        try:
            with redirect_stderr(said):
                parser.parse_args(arguments)
        except SystemExit as stop:
            return said.getvalue().strip().splitlines()[-1] if stop.code else ""
        return ""
    return _name_problem(parser, arguments)


def _name_problem(parser: argparse.ArgumentParser, arguments: list[str]) -> str:
    while subparsers := [action for action in parser._actions if isinstance(action, argparse._SubParsersAction)]:
        if not arguments or not re.match("[a-z]", arguments[0]):
            break
        name = arguments.pop(0)
        if name not in subparsers[0].choices:
            return f"there is no command {name!r}"
        parser = subparsers[0].choices[name]
    known = {option for action in parser._actions for option in action.option_strings}
    unknown = [word for word in arguments if word.startswith("--") and word not in known]
    return f"there is no option {', '.join(unknown)}" if unknown else ""


def make_targets() -> set[str]:
    """Return the targets of the Makefile."""
    text = (ROOT / "Makefile").read_text(encoding="utf-8")
    return set(re.findall(r"^([a-z][\w-]*):(?!=)", text, re.MULTILINE)) | {"bpy-test"}
