"""The motion that benchmarks run on: test takes, and databases without them."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from perfanim.core.body.motion import Motion, resampled, sliced
from perfanim.core.database.build_database import BuildSettings, build_database
from perfanim.core.database.store import Clip, Database, open_database
from perfanim.core.errors import FormatError
from perfanim.core.formats.motion.motion_sources import MotionFile, motion_files
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.system.progress import Progress

from .subset import write_subset

FPS = 60.0
CMU, BANDAI = "cmu", "bandai"
LEFT_OUT = ("16_16", "35_01", "16_02", "09_03", "86_01")  # takes that no database of a benchmark holds
SPLIT, SPLIT_AT = "14_02", 2 / 3  # the first two thirds of this take are in the databases, the last is a test


@dataclass(frozen=True)
class TestTake:
    """A take, or a part of one, to solve.

    Args:
        title: name in tables and plots.
        trial: name of its file.
        first, last: shares of the take at which the part begins and ends.
    """

    title: str
    trial: str
    first: float = 0.0
    last: float = 1.0


WALKING = TestTake("walking (16_16)", "16_16")
UNLIKE = TestTake("jumps, kicks and punches (86_01)", "86_01")  # of a performer without other takes
BOXING = TestTake("boxing (14_02, last third)", SPLIT, SPLIT_AT)


def data_folders(data: Path, names: tuple[str, ...]) -> list[Path]:
    """Return the folders of motion below `data`, or raise FormatError."""
    folders = [data / name for name in names]
    for folder in folders:
        if not folder.is_dir():
            raise FormatError(
                "there is no such folder",
                where=str(folder),
                advice=f"give the folder that holds {' and '.join(names)} with --data",
            )
    return folders


def read_take(data: Path, take: TestTake, folder: str = CMU) -> Motion:
    """Return a test take at the rate of the databases."""
    file = _file_of(data, take, folder)
    motion = resampled(read_motion(file.path, file.skeleton), FPS)
    return sliced(motion, int(motion.frames * take.first), int(motion.frames * take.last))


def skeleton_path(data: Path, take: TestTake, folder: str = CMU) -> Path:
    """Return the file that holds a test take's skeleton."""
    file = _file_of(data, take, folder)
    return file.skeleton or file.path


def _file_of(data: Path, take: TestTake, folder: str) -> MotionFile:
    with motion_files(data_folders(data, (folder,))) as files:
        for file in files:
            if file.stem == take.trial:
                return file
    raise FormatError(f"take {take.trial} is missing", where=str(data / folder))


def development_takes(data: Path, count: int) -> dict[str, Motion]:
    """Return up to `count` takes by name, evenly chosen, none of the test takes."""
    with motion_files(data_folders(data, (CMU,))) as files:
        free = sorted((file for file in files if file.stem not in (*LEFT_OUT, SPLIT)), key=lambda file: file.stem)
        chosen = [free[i * len(free) // count] for i in range(count)] if count < len(free) else free
        return {file.stem: resampled(read_motion(file.path, file.skeleton), FPS) for file in chosen}


def whole_database(data: Path, out: Path, sets: tuple[str, ...], workers: int, progress: Progress) -> Database:
    """Return the database of all motion of the sets, built in `out` if missing."""
    path = out / "databases" / ("-".join(sets) + ".pfdb")
    if not path.exists():
        build_database(
            data_folders(data, sets),
            path,
            BuildSettings(fps=FPS, workers=workers),
            progress=lambda f, text: progress(0.2 * f, text),
        )
    return open_database(path)


def without_tests(database: Database, path: Path, chosen: Callable[[Clip], bool] = lambda clip: True) -> Database:
    """Return a database of the chosen clips without the test takes, built if missing."""
    if path.exists():
        return open_database(path)
    frames = {clip: clip.stop - clip.start for clip in database.clips if clip.name not in LEFT_OUT and chosen(clip)}
    frames |= {clip: int(count * SPLIT_AT) for clip, count in frames.items() if clip.name == SPLIT}
    return write_subset(database, path, [(clip, 0, count) for clip, count in frames.items() if count > 0])


def without_subject(database: Database, folder: Path, subject: str) -> Database:
    """Return the database without test takes and a subject, built if missing."""
    path = folder / f"cmu-without-subject-{subject}.pfdb"
    return without_tests(database, path, lambda clip: clip.subject != subject)
