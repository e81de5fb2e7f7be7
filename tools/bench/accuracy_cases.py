"""Takes of the accuracy bench, with the database of each condition."""

import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from perfanim.core.body.motion import Motion, sliced
from perfanim.core.database.build_database import BuildSettings, build_database
from perfanim.core.database.file_selection import subject_of
from perfanim.core.database.store import Database, open_database
from perfanim.core.system.assets import MOTION
from perfanim.core.system.progress import Progress

from .baseline import Baseline
from .data import (
    BANDAI,
    BOXING,
    CMU,
    FPS,
    WALKING,
    TestTake,
    read_take,
    skeleton_path,
    whole_database,
    without_subject,
    without_tests,
)

TAKES = (
    WALKING,
    TestTake("walking (35_01)", "35_01"),
    TestTake("jumping (16_02)", "16_02"),
    TestTake("running (09_03)", "09_03"),
    BOXING,
    TestTake("jumps, kicks, punches (86_01)", "86_01"),
)
STUDIO_TAKES = tuple(
    TestTake(trial, trial, 0.2)
    for trial in (
        "dataset-1_bow_normal_001",
        "dataset-1_dash_normal_001",
        "dataset-1_guide_normal_001",
        "dataset-1_walk-back_normal_001",
        "dataset-2_raise-up-right-hand_active_027",
        "dataset-2_walk_youthful_025",
        "dataset-2_wave-both-hands_feminine_004",
    )
)
UNSEEN_CLIP, UNSEEN_SUBJECT, UNSEEN_KIND = "unseen clip", "unseen subject", "unseen kind of motion"
STUDIO, OTHER_STUDIO = "Bandai-Namco by CMU", "CMU by Bandai-Namco"  # studios
EMBEDDED = "embedded motion alone"
CONDITIONS = (UNSEEN_CLIP, UNSEEN_SUBJECT, UNSEEN_KIND, STUDIO, OTHER_STUDIO, EMBEDDED)
_KINDS = {
    "walk": "walk",
    "jump": r"jump|hop",
    "run": r"run|jog|dash",
    "box": r"box|punch|kick",
    "kick": r"jump|kick|box",
}
_KIND_OF_TRIAL = {"16_16": "walk", "35_01": "walk", "16_02": "jump", "09_03": "run", "14_02": "box", "86_01": "kick"}


@dataclass(frozen=True)
class Case:
    """A take to be solved with a database; another process may read it.

    Args:
        truth: its first frames.
        skeleton: file with the body.
        database: file.
    """

    condition: str
    take: TestTake
    truth: Motion
    skeleton: Path
    database: Path

    @property
    def of(self) -> dict[str, str]:
        """The columns that name it in tables."""
        return {"condition": self.condition, "take": self.take.title}

    def baseline_database(self, baseline: Baseline) -> Path:
        """Return another version's database of the same motion, built if missing."""
        if self.condition == EMBEDDED:
            return baseline.embedded_database()
        clips = {clip.name for clip in open_database(self.database).clips}
        sets = (BANDAI,) if self.condition == OTHER_STUDIO else (CMU,)
        return baseline.database(self.database.stem, clips, sets)


def cases_of(data: Path, out: Path, frames: int, workers: int, progress: Progress) -> Iterable[Case]:
    """Yield the takes of all conditions, at most their first frames.

    Databases are built if missing.
    """
    whole, folder = whole_database(data, out, (CMU,), workers, progress), out / "databases"
    bandai = whole_database(data, out, (BANDAI,), workers, progress)
    embedded = _embedded_database(folder)
    for take in TAKES:
        truth = _first(read_take(data, take), frames)
        databases = _databases(whole, folder, take) | {OTHER_STUDIO: bandai, EMBEDDED: embedded}
        for condition, database in databases.items():
            yield Case(condition, take, truth, skeleton_path(data, take), database.path)
    for take in STUDIO_TAKES:
        truth = _first(read_take(data, take, BANDAI), frames)
        yield Case(STUDIO, take, truth, skeleton_path(data, take, BANDAI), whole.path)


def _first(motion: Motion, frames: int) -> Motion:
    return sliced(motion, 0, min(frames, motion.frames))


def _embedded_database(folder: Path) -> Database:
    path = folder / "embedded.pfdb"
    if not path.exists():
        build_database([MOTION], path, BuildSettings(fps=FPS, workers=1))
    return open_database(path)


def _databases(whole: Database, folder: Path, take: TestTake) -> dict[str, Database]:
    """Return the CMU database of each condition.

    If the subject has no other clips an unseen clip is an unseen subject.
    """
    unseen = without_subject(whole, folder, subject_of(take.trial))
    clip_unseen = without_tests(whole, folder / "cmu-without-tests.pfdb")
    kind = _KIND_OF_TRIAL[take.trial]
    words = re.compile(_KINDS[kind])
    kind_unseen = without_tests(
        whole, folder / f"cmu-without-kind-{kind}.pfdb", lambda clip: not words.search(clip.behaviour.lower())
    )
    databases = {UNSEEN_CLIP: clip_unseen, UNSEEN_SUBJECT: unseen, UNSEEN_KIND: kind_unseen}
    if clip_unseen.frames == unseen.frames:
        del databases[UNSEEN_CLIP]
    return databases
