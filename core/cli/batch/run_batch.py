"""Run of a batch, from its plan to its summary."""

import os
import shutil
import tempfile
import time
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from ...errors import SettingsError
from ...system.files import clean_folder, is_file, writing
from ...system.lock import lock
from ...system.progress import Progress
from .content_hash import ContentDigests, take_digest
from .plan import REPORT, TakePlan
from .summary import write_summary
from .take_record import BAD, Record, Task, finished_record, remove_old, unwritten_record

DoTasks = Callable[[Sequence[Task]], Generator[Record, None, None]]

_UNFINISHED = ".unfinished-"


@dataclass(frozen=True)
class BatchResult:
    """Result of a batch.

    Args:
        records: Records of its takes, sorted by name.
        finished_before: Names of the takes that an earlier run had finished.
    """

    records: tuple[Record, ...]
    finished_before: frozenset[str]
    page: Path


def run_batch(takes: Sequence[TakePlan], out: Path, do_tasks: DoTasks, progress: Progress) -> BatchResult:
    """Process the takes that are not finished yet, and summarise all of them.

    The folder's final content depends on the takes only, not on their order, the processes, or interruptions.

    Args:
        takes: Takes with unique names.
        do_tasks: Processes takes and yields their records in any order (see `in_processes`, `on_cluster`).

    Raises:
        FormatError: the folder cannot be written. SettingsError: another batch is writing to this folder.
    """
    with _workplace(out) as work:
        progress(0.0, "looking for finished takes")
        contents = ContentDigests()
        takes = sorted((replace(take, digest=take_digest(take, contents)) for take in takes), key=lambda t: t.name)
        done: dict[str, Record] = {}
        left: list[TakePlan] = []
        finished_before = set[str]()
        for take in takes:
            record = finished_record(take, out)
            if record is not None:
                done[take.name] = replace(record, source=take.source)
                finished_before.add(take.name)
                continue
            try:
                remove_old(take, out)
                left.append(take)
            except OSError as error:  # the other takes continue
                done[take.name] = unwritten_record(take, error)
        if left:
            _do(left, out, work, do_tasks, done, progress)
        records = tuple(done[take.name] for take in takes)
        progress(1.0, "writing the summary")
        page = write_summary(records, out, work)
        return BatchResult(records, frozenset(finished_before), page)


def _do(
    left: Sequence[TakePlan], out: Path, work: Path, do_tasks: DoTasks, done: dict[str, Record], progress: Progress
) -> None:
    weights = {take.name: _weight(take) for take in left}
    # keep a performer's takes together, because a process prepares each performer once; start with the long ones, so
    # that no process is left working on one while the others are idle
    ordered = sorted(left, key=lambda take: (take.options_of("solve"), -weights[take.name], take.name))
    total, finished, solved, started = sum(weights.values()), 0, 0, time.monotonic()
    before, bad = len(done), sum(record.status == BAD for record in done.values())
    count = before + len(left)
    progress(0.0, f"{before} of {count} takes")
    with closing(do_tasks([Task(take, str(out.absolute()), str(work)) for take in ordered])) as records:
        for record in records:
            done[record.name] = record
            finished += weights[record.name]
            bad += record.status == BAD
            solved += weights[record.name] * (record.status != BAD)
            line = f"{len(done)} of {count} takes, {bad} bad"
            if solved:  # bad takes end early and say nothing about the time left
                left_s = (time.monotonic() - started) * (total - finished) / solved
                line += f", {_duration(left_s)} left"
            progress(finished / total, line)


def _weight(take: TakePlan) -> int:
    """Return the expected work for a take: the size of its files in bytes."""
    sources = [take.take] if take.take else [str(take.options.get(key, "")) for key in ("left", "right")]
    return 1 + sum(Path(source).stat().st_size for source in sources if source and is_file(source))


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours} h {minutes:02d} min" if hours else f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"


@contextmanager
def _workplace(out: Path) -> Iterator[Path]:
    """Yield a new folder below `out` for unfinished files and remove it at the end."""
    with writing(out):
        (out / REPORT).mkdir(parents=True, exist_ok=True)
        handle = os.open(out / REPORT / ".lock", os.O_RDWR | os.O_CREAT, 0o666)
    try:
        if not lock(handle):
            raise SettingsError(
                "another batch is writing there", where=str(out), advice="wait for it, or choose another folder"
            )
        for old in out.glob(f"{_UNFINISHED}*"):  # left by a run that was killed
            shutil.rmtree(old, ignore_errors=True)
        clean_folder(out)
        work = Path(tempfile.mkdtemp(prefix=_UNFINISHED, dir=out)).absolute()
        try:
            yield work
        finally:
            shutil.rmtree(work, ignore_errors=True)
    finally:
        os.close(handle)
