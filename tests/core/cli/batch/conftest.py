"""A folder of takes of all kinds, good and bad, and what does them without another process."""

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from perfanim.core.cli.batch.batch_command import take_server
from perfanim.core.cli.batch.plan import TakePlan, plan_of
from perfanim.core.cli.batch.processes import in_processes
from perfanim.core.cli.batch.run_batch import BatchResult, DoTasks, run_batch
from perfanim.core.cli.batch.take_record import Record, Task
from perfanim.core.formats.markers.marker_files import write_take
from perfanim.core.markers.marker_take import MarkerTake
from perfanim.core.markers.subject import save_subject
from perfanim.core.simulate.simulated_markers import simulate_markers

GOOD = ("a.c3d", "b.trc", "c.csv", "d.take.npz")
FRAMES = 14


@dataclass(frozen=True)
class Inputs:
    """Where the files of a batch are."""

    takes: Path
    database: Path
    subject: Path

    def plan(self, *names: str, **options: str) -> tuple[TakePlan, ...]:
        """Return the plan of some of the takes, of all without names."""
        given = {"database": str(self.database), "subject": str(self.subject), **options}
        return plan_of([str(self.takes / name) for name in names or [""]], given).takes


@pytest.fixture(scope="session")
def make_takes(truth, subject) -> Callable[[Path], None]:
    """make_takes(folder): writes four good takes and five bad ones."""

    def make(folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        for seed, name in enumerate(GOOD):
            write_take(cut(simulate_markers(truth, subject, noise_mm=1.0, seed=seed)[0]), folder / name)
        walk = cut(simulate_markers(truth, subject)[0])
        (folder / "broken.trc").write_text("PathFileType\t4\nno more than that\n")
        (folder / "empty.c3d").write_bytes(b"")
        blank = np.full_like(walk.positions_m, np.nan)
        write_take(replace(walk, positions_m=blank), folder / "blank.csv")
        seven = replace(walk, names=tuple(f"M{i}" for i in range(7)), positions_m=walk.positions_m[:, :7])
        write_take(seven, folder / "foreign.csv")  # eight would be named by their places
        write_take(replace(walk, names=tuple(reversed(walk.names))), folder / "exchanged.take.npz")

    return make


def cut(take: MarkerTake) -> MarkerTake:
    """Return the first frames of a take."""
    return MarkerTake(take.name, take.fps, take.names, take.positions_m[:FRAMES])


@pytest.fixture(scope="session")
def inputs(make_takes, database_file, subject, tmp_path_factory) -> Inputs:
    folder = tmp_path_factory.mktemp("batch")
    make_takes(folder / "takes")
    save_subject(subject, folder / "walker.toml")
    return Inputs(folder / "takes", database_file, folder / "walker.toml")


def in_others(jobs: int, tasks: Sequence[Task]) -> Generator[Record, None, None]:
    """Do takes in other processes."""
    yield from in_processes(take_server.serve, jobs, tasks)


def do_here(tasks: Sequence[Task]) -> Generator[Record, None, None]:
    """Do takes in this process, whose libraries may reckon with several threads, which give other last bits."""
    for task in tasks:
        yield Record.of_text(take_server.serve_task(task.text()))


def run(takes: Sequence[TakePlan], out: Path, do_tasks: DoTasks = do_here) -> BatchResult:
    """Return what came of takes."""
    return run_batch(takes, out, do_tasks, lambda fraction, text: None)


@pytest.fixture(scope="session")
def finished(inputs, tmp_path_factory) -> tuple[Path, BatchResult]:
    """The results of all takes, done once by one process, and what was told."""
    out = tmp_path_factory.mktemp("finished")
    return out, run(inputs.plan(), out, partial(in_others, 1))


def files(folder: Path) -> dict[str, bytes]:
    """Return every file below a folder by its path."""
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}
