"""Processing one take of a batch, from its file or videos to its outputs and record."""

import os
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from ...errors import PerfanimError
from ...formats.motion.write_motion import write_motion
from ...retarget.displayed_joint_names import OWN
from ...session.solved_take import SolvedTake
from .content_hash import file_digest
from .plan import ALSO, REPORT, TakePlan
from .quality import quality_figures, why_doubtful
from .take_record import BAD, DOUBTFUL, GOOD, Record, Task, failed_record, record_path, unwritten_record
from .thumbnail_strip import write_strip

if TYPE_CHECKING:
    from .take_server import CommandLine


def run_task(task: Task, commands: "CommandLine") -> Record:
    """Process one take: write all of its outputs and its record, or none."""
    take, out, work = task.take, Path(task.out), Path(task.work) / task.take.name
    try:
        work.mkdir(parents=True)
        record = TakePipeline(take, work, commands).run()
        if record.is_kept:
            _move_outputs(record, work, out)
    except OSError as error:
        return unwritten_record(take, error)
    except Exception as error:  # last resort, so that the other takes continue
        return failed_record(take, f"failed unexpectedly: {type(error).__name__}: {error}")
    finally:
        shutil.rmtree(work, ignore_errors=True)
    return record


class TakePipeline:
    """The steps of one take, in a folder of its own."""

    def __init__(self, take: TakePlan, work: Path, commands: "CommandLine") -> None:
        self._take = take
        self._work = work
        self._commands = commands
        self._outputs: dict[str, str] = {}
        self._warnings: list[str] = []
        self._doubts: list[str] = []

    def run(self) -> Record:
        """Return the record of the steps; the folder then contains the output files."""
        try:
            solved = self._solve()
        except PerfanimError as error:
            # failing to write a file is not the take's fault
            return self._record(BAD, [self._reason(error)], is_kept=not error.where.startswith(str(self._work)))
        figures = quality_figures(solved)
        self._keep("picture", f"{self._take.name}.jpg", lambda path: write_strip(solved, path))
        verdict = solved.verdict
        reasons = [reason.text for reason in verdict.reasons]
        if verdict.is_useless:
            self._outputs = {kind: name for kind, name in self._outputs.items() if kind not in ("motion", *ALSO)}
            return self._record(BAD, reasons[:1], figures)
        try:
            self._retarget()
        except PerfanimError as error:
            return self._record(BAD, [self._reason(error)], figures, is_kept=False)
        doubts = [*self._doubts, *reasons, *why_doubtful(figures)]
        return self._record(DOUBTFUL if doubts else GOOD, doubts, figures)

    def _solve(self) -> SolvedTake:
        name, source = self._take.name, self._take.take
        if self._take.is_tracked:
            self._track()
            source = str(self._work / self._outputs["markers"])
        motion = self._work / f"{name}.bvh"
        solved, facts = self._commands.solve([source, *self._take.options_of("solve"), "--out", str(motion)])
        self._warnings += [self._plain(text) for text in facts["warnings"]]
        self._outputs["motion"] = motion.name
        self._write_also(solved)
        if cut := facts.get("cut_off_frames", 0):
            count = len(solved.poses)
            self._doubts.append(f"the file was cut off: it holds {count} of {count + cut} frames")
        if not facts.get("complete", True):
            self._doubts.append("the recording was cut off")
        return solved

    def _write_also(self, solved: SolvedTake) -> None:
        """Write the motion in the other formats requested."""
        options = self._take.options
        kinds, naming, rate = options.get("also"), str(options.get("naming", OWN)), options.get("rate")

        def write(path: Path) -> None:
            write_motion(solved.motions_at(rate if isinstance(rate, float) else None)[0], path, naming=naming)

        for ending in kinds if isinstance(kinds, list) else ():
            self._keep(ending, f"{self._take.name}.{ending}", write)

    def _track(self) -> None:
        def write(path: Path) -> None:
            options = [*self._take.options_of("track"), *self._take.options_of("label")]
            facts = self._commands.run("track", [*options, "--out", str(path)])
            self._doubts += facts.get("doubts", [])
            self._warnings += [self._plain(text) for text in facts["warnings"]]

        self._keep("markers", f"{self._take.name}.take.npz", write)

    def _retarget(self) -> None:
        options = self._take.options_of("retarget")
        if not options:
            return
        motion = self._work / self._outputs["motion"]

        def write(path: Path) -> None:
            facts = self._commands.run("retarget", [str(motion), *options, "--out", str(path)])
            if facts["doubtful"] or facts["unmapped"]:
                joints = ", ".join(sorted({**facts["doubtful"], **facts["unmapped"]}))
                self._warnings.append(f"joints whose bone is doubtful or missing: {joints}")

        ending = self._take.options.get("save_as", "blend")
        self._keep("character", f"{self._take.name}.{ending}", write)

    def _keep(self, kind: str, name: str, write: Callable[[Path], object]) -> None:
        write(self._work / name)
        self._outputs[kind] = name

    def _record(
        self,
        status: str,
        reasons: list[str],
        figures: dict[str, float | int | None] | None = None,
        *,
        is_kept: bool = True,
    ) -> Record:
        outputs = {kind: f"{REPORT}/{name}" if kind == "picture" else name for kind, name in self._outputs.items()}
        return Record(
            self._take.name, self._take.source, self._take.digest, status, tuple(reasons), tuple(self._warnings),
            figures or {}, outputs if is_kept else {}, is_kept=is_kept,
        )  # fmt: skip

    def _reason(self, error: PerfanimError) -> str:
        text = " ".join(str(error).split())
        # the record itself names the take
        is_own = error.where in (self._take.take, self._take.name)
        return self._plain(text.removeprefix(f"{error.where}: ") if is_own else text)

    def _plain(self, text: str) -> str:
        """Return a message without this machine's folder names."""
        known = {str(self._work) + os.sep: "", self._take.take: self._take.source}
        for place, name in known.items():
            text = text.replace(place, name) if place else text
        return text


def _move_outputs(record: Record, work: Path, out: Path) -> None:
    """Move the outputs to their final paths, the record last.

    A take with a record is therefore complete.
    """
    (out / REPORT).mkdir(parents=True, exist_ok=True)
    for file in record.outputs.values():
        made = work / Path(file).name
        record.sha256[file] = file_digest(made)
        made.replace(out / file)
    text = work / f"{record.name}.json"
    with text.open("w", encoding="utf-8", newline="\n") as stream:
        stream.write(record.text() + "\n")
        stream.flush()
        os.fsync(stream.fileno())
    text.replace(record_path(out, record.name))
