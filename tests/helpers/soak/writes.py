"""Kill processes that write at random moments, or let the disk be full.

By turns a take is recorded at 60 frames/s, a database built over an old one, notes written into a take, and a motion
exported over an old file. The process is killed (SIGKILL); every fifth time no file may grow beyond so many bytes
instead, as on a full disk (RLIMIT_FSIZE).

- What stood before must be whole: the old file or the new one, never a mixture, and nothing else under the name.
- Of a recording at most 0.25 s may be lost, and all frames before must be as they were given.
- A full disk must be reported in one line, and leave no temporary file; those of killed processes go at the next start.

POSIX only.
"""

import contextlib
import mmap
import os
import random
import resource
import shutil
import signal
import struct
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from perfanim.core.body.motion import sliced
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.database.build_database import BuildSettings, build_database
from perfanim.core.database.store import open_database
from perfanim.core.errors import PerfanimError
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.formats.motion.write_motion import write_motion
from perfanim.core.formats.take_file.append_notes import append_notes
from perfanim.core.formats.take_file.take_reader import read_take_file
from perfanim.core.formats.take_file.take_setup import TakeNotes, TakeSetup
from perfanim.core.formats.take_file.take_writer import TakeWriter
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.markers.marker_frame_codec import pack_stamped
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.subject import Subject
from perfanim.core.simulate.studio.studio_rig import default_rig
from perfanim.core.system.assets import MOTION

from .processes import Row

KILLED, FULL = "killed", "disk full"
MOST_LOST_S = 0.25
RECORDED_S = 1.5
FULL_EVERY = 5
FPS = 60


class Work(NamedTuple):
    """Something that writes.

    Args:
        prepare: puts what stood before into a folder.
        act: writes into the folder.
        fault: names the damage in a folder, "" for none. Its second argument is the number of frames
            that were handed over.
        lasts_s, writes: how long it takes undisturbed, and the bytes of its largest file.
    """

    prepare: Callable[[Path], None]
    act: Callable[[Path], None]
    fault: Callable[[Path, int], str]
    lasts_s: float
    writes: int


class Material:
    """Files that all works start from."""

    def __init__(self, folder: Path) -> None:
        self.motions = [sliced(read_motion(path), 0, 120) for path in sorted(MOTION.glob("*.bvh"))[:3]]
        self.clips = [folder / f"{number}.bvh" for number in range(len(self.motions))]
        for motion, path in zip(self.motions, self.clips, strict=True):
            write_motion(motion, path)
        self.subject = Subject("Anna", default_skeleton(1.7), load_marker_set("boxing"))
        self.old = folder / "old.pfdb"
        self.build(self.old, self.clips[:1])
        self.records = [_record(number) for number in range(round(FPS * RECORDED_S) + FPS)]
        self.take = folder / "take.perftake"
        self._record_to(self.take, self.records, 0.0)
        self.handed_over = mmap.mmap(-1, 8)
        self.wait_s = 1.0 / FPS  # between the frames of a recording

    @staticmethod
    def build(path: Path, clips: list[Path]) -> None:
        """Build a database in this process."""
        build_database(clips, path, BuildSettings(workers=1), progress=lambda fraction, text: None)

    def works(self, folder: Path) -> dict[str, Work]:
        """Return all that is disturbed, measured undisturbed."""
        found = {}
        for name, prepare, act, fault in (
            ("record", self._place_nothing, self._record, self._record_fault),
            ("build", self._place_old, self._build, self._build_fault),
            ("notes", self._place_take, self._edit, self._edit_fault),
            ("export", self._place_motion, self._export, self._export_fault),
        ):
            place = folder / name
            place.mkdir()
            prepare(place)
            begun_s = time.perf_counter()
            act(place)
            lasts_s = time.perf_counter() - begun_s
            wrong = fault(place, len(self.records))
            if wrong:
                raise AssertionError(f"{name}, undisturbed: {wrong}")
            largest = max(path.stat().st_size for path in place.iterdir())
            found[name] = Work(prepare, act, fault, lasts_s, largest)
        return found

    def _place_nothing(self, place: Path) -> None:
        (place / "take.perftake").unlink(missing_ok=True)  # nobody records over a take

    def _record(self, place: Path) -> None:
        self._record_to(place / "take.perftake", self.records, self.wait_s)

    def _record_to(self, path: Path, records: list[bytes], wait_s: float) -> None:
        writer = TakeWriter(path, TakeSetup.of(default_rig(), (self.subject,), {}, {}, {}), TakeNotes("old"))
        for number, record in enumerate(records, start=1):
            writer.add_frame(record)
            if wait_s:
                struct.pack_into("<Q", self.handed_over, 0, number)
                time.sleep(wait_s)
        writer.close()

    def _record_fault(self, place: Path, handed_over: int) -> str:
        path = place / "take.perftake"
        if not path.exists() or path.stat().st_size == 0:
            return "" if handed_over <= MOST_LOST_S * FPS else "there is no take"
        frames = [pack_stamped(time_s, frame) for time_s, frame in read_take_file(path).stamped_frames]
        if frames != self.records[: len(frames)]:
            return "a frame differs"
        lost_s = (handed_over - len(frames)) / FPS
        return f"{lost_s:.2f} s are lost" if lost_s > MOST_LOST_S else ""

    def _place_old(self, place: Path) -> None:
        shutil.copy(self.old, place / "motion.pfdb")

    def _build(self, place: Path) -> None:
        self.build(place / "motion.pfdb", self.clips)

    def _build_fault(self, place: Path, _: int) -> str:
        database = open_database(place / "motion.pfdb")
        if database.poses.shape[0] != database.clips[-1].stop or not np.isfinite(database.poses).all():
            return "the database is half written"
        return "" if len(database.clips) in (1, len(self.clips)) else f"it has {len(database.clips)} clips"

    def _place_take(self, place: Path) -> None:
        shutil.copy(self.take, place / "take.perftake")

    def _edit(self, place: Path) -> None:
        for number in range(20):
            append_notes(place / "take.perftake", TakeNotes(f"new {number}" * 50))

    def _edit_fault(self, place: Path, _: int) -> str:
        take = read_take_file(place / "take.perftake")
        frames = [pack_stamped(time_s, frame) for time_s, frame in take.stamped_frames]
        if frames != self.records:
            return "a frame differs"
        return "" if take.notes.name.startswith(("old", "new")) else f"its name is {take.notes.name!r}"

    def _place_motion(self, place: Path) -> None:
        shutil.copy(self.clips[0], place / "motion.bvh")

    def _export(self, place: Path) -> None:
        write_motion(self.motions[1], place / "motion.bvh")

    def _export_fault(self, place: Path, _: int) -> str:
        found = (place / "motion.bvh").read_bytes()
        return "" if found in (self.clips[0].read_bytes(), self.clips[1].read_bytes()) else "the file is half written"


def _record(number: int) -> bytes:
    points = np.random.default_rng(number).normal(size=(9, 3))
    return pack_stamped(float(number), MarkerFrame(number, number / FPS, points, np.zeros((9, 3, 3))))


def disturbed(work: Work, material: Material, place: Path, fault: str, chance: random.Random) -> dict[str, Any]:
    """Do a work in a process with a fault; return its row."""
    place.mkdir()
    work.prepare(place)
    struct.pack_into("<Q", material.handed_over, 0, 0)
    limit = chance.randrange(1, work.writes + 1)
    after_s = chance.uniform(0.0, 1.1 * work.lasts_s)
    child = os.fork()
    if child == 0:
        os._exit(_act(work, place, limit if fault == FULL else None))
    if fault == KILLED:
        time.sleep(after_s)
        with contextlib.suppress(ProcessLookupError):
            os.kill(child, signal.SIGKILL)
    _, status = os.waitpid(child, 0)
    (handed_over,) = struct.unpack_from("<Q", material.handed_over, 0)
    try:
        wrong = work.fault(place, handed_over if fault == KILLED else 0)
    except (PerfanimError, OSError) as error:
        wrong = str(error)
    if fault == FULL and status:
        wrong = wrong or "no error in one line"
    if not wrong:
        wrong = _left_behind(place, work, material, fault)
    return {"fault": fault, "at": limit if fault == FULL else round(after_s, 4), "wrong": wrong}


def _act(work: Work, place: Path, limit: int | None) -> int:
    """Do a work in this process; return 0 where it ended, or was refused in one line."""
    if limit is not None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
    try:
        work.act(place)
    except PerfanimError as error:
        return 0 if "\n" not in str(error) else 2
    except Exception:
        return 3
    return 0


def _left_behind(place: Path, work: Work, material: Material, fault: str) -> str:
    """Return the temporary files that a full disk leaves, or another run after a kill."""
    if fault == KILLED:
        for path in place.rglob("*"):
            os.utime(path, (0.0, 0.0))  # as if it had been long ago
        work.prepare(place)
        usual_s, material.wait_s = material.wait_s, 0.0
        work.act(place)
        material.wait_s = usual_s
    left = [path.name for path in place.iterdir() if path.name.startswith(".")]
    return f"left behind: {', '.join(left)}" if left else ""


def rows(count: int, seed: int) -> Iterator[Row]:
    """Yield the row of each disturbed work, by turns."""
    chance = random.Random(seed)  # noqa: S311 - moments, no secrets
    with tempfile.TemporaryDirectory(prefix="write-soak-") as name:
        folder = Path(name)
        material = Material(folder)
        works = material.works(folder)
        for number in range(count):
            place = folder / f"place-{number}"
            work = list(works)[number % len(works)]
            fault = FULL if number % FULL_EVERY == FULL_EVERY - 1 else KILLED
            yield {"work": work} | disturbed(works[work], material, place, fault, chance)
            shutil.rmtree(place, ignore_errors=True)
