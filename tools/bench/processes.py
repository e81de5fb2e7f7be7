"""Parts of a bench solved in several processes."""

import json
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import AbstractContextManager
from multiprocessing import get_context
from pathlib import Path
from typing import Any, TypeVar

from perfanim.core.system.progress import Progress

Result = TypeVar("Result")
Row = Mapping[str, Any]


class Processes(AbstractContextManager["Processes"]):
    """Processes for the jobs of a bench; rows are written as they come.

    Args:
        count: how many.
        out: folder of the rows.
    """

    def __init__(self, count: int, out: Path) -> None:
        self._pool = ProcessPoolExecutor(count, get_context("spawn"))
        self._out = out

    def __exit__(self, *_: object) -> None:
        """Drop the jobs that have not begun, and end."""
        self._pool.shutdown(cancel_futures=True)

    def run(
        self,
        name: str,
        function: Callable[..., Result],
        jobs: Mapping[str, tuple[Any, ...]],
        rows_of: Callable[[Result], Sequence[Row]],
        progress: Progress,
    ) -> list[Result]:
        """Return the results of a function in the order of its jobs.

        Each result's rows go to NAME.jsonl as it comes, a line of JSON each: all jobs may last for hours.

        Args:
            jobs: arguments of each, by its title.
        """
        done: dict[str, Result] = {}
        with (self._out / f"{name}.jsonl").open("w", encoding="utf-8") as stream:
            titles = {self._pool.submit(function, *arguments): title for title, arguments in jobs.items()}
            for job in as_completed(titles):
                done[titles[job]] = result = job.result()
                stream.writelines(json.dumps(row) + "\n" for row in rows_of(result))
                stream.flush()
                progress(len(done) / len(jobs), f"{name}: {titles[job]}")
        return [done[title] for title in jobs]
