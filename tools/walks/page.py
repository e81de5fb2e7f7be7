"""Page of a walk: the commands of each step, their output, and pictures."""

import html
import os
import shlex
import shutil
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
_LONGEST_S = 900
_MOST_LINES = 40  # of an output
_HEAD = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>{title}</title><style>
body {{ max-width: 60em; margin: 2em auto; padding: 0 1em; font: 16px/1.5 sans-serif; color: #222 }}
pre {{ background: #f2f2f2; padding: .8em; overflow-x: auto; font-size: 13px }} img {{ max-width: 100% }}
figure {{ display: inline-block; margin: 0 1em 1em 0; max-width: 30em }}
</style></head><body><h1>{title}</h1>
"""


class WalkError(Exception):
    """A step did not end as the documents say."""


class Walk:
    """A walk in a folder of its own; `index.html` there grows with each step.

    Args:
        environment: variables that the programs get beside those of this process.
    """

    def __init__(self, title: str, folder: Path, environment: Mapping[str, str] | None = None) -> None:
        self.folder = folder
        self._environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", **(environment or {})}
        self._steps = 0
        shutil.rmtree(folder, ignore_errors=True)
        (folder / "pictures").mkdir(parents=True)
        self._page = folder / "index.html"
        self._page.write_text(_HEAD.format(title=html.escape(title)), encoding="utf-8")

    def step(self, title: str, text: str = "") -> None:
        """Begin a step."""
        self._steps += 1
        sys.stdout.write(f"{self._steps}. {title}\n")
        self._add(f"<h2>{self._steps}. {html.escape(title)}</h2>")
        if text:
            self._add(f"<p>{html.escape(text)}</p>")

    def run(self, *words: str | Path, at: Path | None = None, status: int = 0) -> str:
        """Run a program, note it on the page, and return its output.

        Args:
            words: `perfanim` or `python` first, or another program.
            status: with which it has to end.

        Raises:
            WalkError: it ends with another one.
        """
        shown = [str(word) for word in words]
        programs = {"perfanim": [sys.executable, "-m", "perfanim.core.cli.main"], "python": [sys.executable]}
        done = subprocess.run(
            [*programs.get(shown[0], [shown[0]]), *shown[1:]],
            cwd=at or self.folder,
            env=self._environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            encoding="utf-8",
            errors="replace",
            timeout=_LONGEST_S,
        )
        self.note(f"$ {shlex.join(shown)}", done.stdout)
        if done.returncode != status:
            raise WalkError(f"{shlex.join(shown)}: exit status {done.returncode}, not {status}\n{done.stdout[-3000:]}")
        return done.stdout

    def note(self, *texts: str) -> None:
        """Put text on the page as it stands, its middle left out where it is long."""
        lines = [line for text in texts for line in text.rstrip().splitlines()]
        if len(lines) > _MOST_LINES:
            left_out = f"... ({len(lines) - _MOST_LINES} lines)"
            lines = [*lines[: _MOST_LINES // 2], left_out, *lines[-_MOST_LINES // 2 :]]
        self._add(f"<pre>{html.escape(chr(10).join(lines))}</pre>")

    def show(self, pictures: Sequence[Path]) -> None:
        """Put pictures on the page, with their names."""
        for picture in pictures:
            kept = self.folder / "pictures" / f"{self._steps:02d}-{picture.name}"
            shutil.copy(picture, kept)
            name = html.escape(picture.name)
            self._add(f'<figure><img src="pictures/{kept.name}" alt="{name}"><figcaption>{name}</figcaption></figure>')

    def link(self, page: Path, text: str) -> None:
        """Put a link to a page of the walk's folder on the page."""
        self._add(f'<p><a href="{page.relative_to(self.folder).as_posix()}">{html.escape(text)}</a></p>')

    def _add(self, markup: str) -> None:
        with self._page.open("a", encoding="utf-8") as page:
            page.write(markup + "\n")
