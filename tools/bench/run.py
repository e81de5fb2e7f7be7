"""Run of a benchmark: motion to read, databases without the takes they solve, processes, output files."""

import csv
import json
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any, TypeVar

from perfanim.core.body.motion import Motion, resampled, sliced
from perfanim.core.database.build_database import BuildSettings, build_database
from perfanim.core.database.header_facts import Clip
from perfanim.core.database.store import Database, open_database
from perfanim.core.errors import FormatError
from perfanim.core.formats.motion.motion_sources import MotionFile, motion_files
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.solver.motion_prior import open_network
from perfanim.core.solver.settings import BestSettings, SolveSettings
from perfanim.core.system.assets import MOTION
from perfanim.core.system.files import atomic_path
from perfanim.core.system.progress import Progress, no_progress

from .scenarios import CMU, FPS, LEFT_OUT, NO_PRIOR, SPLIT, SPLIT_AT, Take
from .subset import Part, write_subset

Result = TypeVar("Result")
Rows = Sequence[Mapping[str, Any]]


@dataclass(frozen=True)
class Run:
    """One run of a benchmark.

    Args:
        data: Folder that contains cmu/ and bandai/.
        out: Folder to write to; databases are kept in databases/ and built if missing.
        workers: Number of processes that read motion and solve.
    """

    data: Path
    out: Path
    workers: int = 2
    progress: Progress = no_progress

    # ---- motion

    def folders(self, names: Iterable[str]) -> list[Path]:
        """Return the folders of motion below `data`.

        Raises:
            FormatError: One is missing.
        """
        folders = [self.data / name for name in names]
        for folder in folders:
            if not folder.is_dir():
                advice = f"give the folder that holds {' and '.join(names)} with --data"
                raise FormatError("there is no such folder", where=str(folder), advice=advice)
        return folders

    def file_of(self, take: Take) -> MotionFile:
        """Return the file of a take."""
        with motion_files(self.folders((take.folder,))) as files:
            for file in files:
                if file.stem == take.trial:
                    return file
        raise FormatError(f"take {take.trial} is missing", where=str(self.data / take.folder))

    def read(self, take: Take) -> Motion:
        """Return a take at the rate of the databases."""
        file = self.file_of(take)
        motion = resampled(read_motion(file.path, file.skeleton), FPS)
        return sliced(motion, int(motion.frames * take.first), int(motion.frames * take.last))

    def development_takes(self, count: int) -> dict[str, Motion]:
        """Return up to `count` takes by name, evenly spread, excluding the test takes."""
        with motion_files(self.folders((CMU,))) as files:
            free = sorted((file for file in files if file.stem not in (*LEFT_OUT, SPLIT)), key=lambda file: file.stem)
            chosen = [free[i * len(free) // count] for i in range(count)] if count < len(free) else free
            return {file.stem: resampled(read_motion(file.path, file.skeleton), FPS) for file in chosen}

    # ---- databases

    def path_of(self, name: str) -> Path:
        """Return the file of a database."""
        return self.out / "databases" / f"{name}.pfdb"

    def built(self, name: str, folders: Sequence[Path], **settings: Any) -> Database:
        """Return a database of all motion in folders."""
        if not (path := self.path_of(name)).exists():
            chosen = BuildSettings(fps=FPS, workers=self.workers, **settings)
            build_database(folders, path, chosen, progress=lambda share, text: self.progress(0.2 * share, text))
        return open_database(path)

    def whole(self, *sets: str) -> Database:
        """Return the database of all motion in the sets."""
        return self.built("-".join(sets), self.folders(sets))

    def embedded(self) -> Database:
        """Return the database of the shipped motion."""
        return self.built("embedded", [MOTION])

    def subset(self, whole: Database, name: str, kept: Iterable[Part]) -> Database:
        """Return a database made of parts of another."""
        path = self.path_of(name)
        return open_database(path) if path.exists() else write_subset(whole, path, kept)

    def without_tests(
        self, whole: Database, name: str = "cmu-without-tests", chosen: Callable[[Clip], bool] = lambda clip: True
    ) -> Database:
        """Return a database of the chosen clips without the test takes."""
        clips = {clip: clip.stop - clip.start for clip in whole.clips if clip.name not in LEFT_OUT and chosen(clip)}
        clips |= {clip: int(count * SPLIT_AT) for clip, count in clips.items() if clip.name == SPLIT}
        return self.subset(whole, name, [(clip, 0, count) for clip, count in clips.items() if count > 0])

    def without_subject(self, whole: Database, subject: str) -> Database:
        """Return the database without test takes and without a subject."""
        return self.without_tests(whole, f"cmu-without-subject-{subject}", lambda clip: clip.subject != subject)

    def without_takes(self, whole: Database, name: str, takes: Collection[Take]) -> Database:
        """Return the database without takes; the beginning of the split take is kept."""
        last = {take.trial: 0.0 for take in takes}
        last |= {SPLIT: min(take.first for take in takes if take.trial == SPLIT)} if SPLIT in last else {}
        kept = [(clip, 0, int((clip.stop - clip.start) * last.get(clip.name, 1.0))) for clip in whole.clips]
        return self.subset(whole, name, [part for part in kept if part[2] > 0])

    def settings_for(self, subject: str) -> SolveSettings:
        """Return the default settings with a prior that has not seen the subject.

        The prior is the first of those next to the databases (`motion_prior*.npz`, see `tools/train_prior.py`) that was
        not trained on the subject, never the shipped one, which has seen everyone; none if there is no such file.
        """
        best = NO_PRIOR
        for path in sorted((self.out / "databases").glob("motion_prior*.npz"), reverse=True):
            network = open_network(path)
            if network is not None and subject not in network.facts["subjects"]:
                best = BestSettings(prior_share=1.0, prior_file=str(path))
        return SolveSettings(best=best)

    # ---- work and files

    def each(
        self,
        name: str,
        function: Callable[..., Result],
        jobs: Mapping[str, tuple[Any, ...]],
        rows_of: Callable[[Result], Rows] = lambda result: (),
    ) -> list[Result]:
        """Return the results of a function computed in several processes, in the order of its jobs.

        Each result's rows are written to NAME.jsonl as they arrive, because all jobs together may take hours.

        Args:
            jobs: Arguments of each job, by its title.
            rows_of: Returns the rows of a result.
        """
        self.out.mkdir(parents=True, exist_ok=True)
        pool = ProcessPoolExecutor(self.workers, get_context("spawn"))
        done: dict[str, Result] = {}
        try:
            with (self.out / f"{name}.jsonl").open("w", encoding="utf-8") as stream:
                titles = {pool.submit(function, *arguments): title for title, arguments in jobs.items()}
                for job in as_completed(titles):
                    done[titles[job]] = result = job.result()
                    stream.writelines(json.dumps(row) + "\n" for row in rows_of(result))
                    stream.flush()
                    self.progress(len(done) / len(jobs), f"{name}: {titles[job]}")
        finally:
            pool.shutdown(cancel_futures=True)
        return [done[title] for title in jobs]

    def write(
        self, bench: str, figures: dict[str, Any], tables: Mapping[str, Rows], plots: Sequence[Path] = ()
    ) -> dict[str, Any]:
        """Write figures as JSON and tables as CSV; return the figures with the paths.

        Args:
            tables: Rows with equal keys, by the suffix of the file name; "" for the benchmark's own table.
        """
        path = self.out / f"{bench}.json"
        with atomic_path(path) as temporary:
            temporary.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
        paths = [path]
        for name, rows in tables.items():
            if not rows:
                continue
            paths.append(self.out / (f"{bench}-{name}.csv" if name else f"{bench}.csv"))
            with atomic_path(paths[-1]) as temporary, temporary.open("w", newline="", encoding="utf-8") as stream:
                writer = csv.DictWriter(stream, list(rows[0]))
                writer.writeheader()
                writer.writerows(rows)
        return figures | {"outputs": [str(each) for each in (*paths, *plots)]}
