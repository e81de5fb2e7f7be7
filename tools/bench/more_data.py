"""Whether more data harms: takes solved with all subjects and with half of them."""

from pathlib import Path
from typing import Any

import numpy as np
from perfanim.core.body.motion import Motion, sliced
from perfanim.core.database.file_selection import subject_of
from perfanim.core.database.store import Database
from perfanim.core.solver.settings import SolveSettings

from .figure6 import degrees_per_joint, solve_truth
from .subset import write_subset

TAKES, FRAMES, HALVES = 10, 200, 2  # halves: each leaves out every second subject of a random order
_SEED = 5


def more_data_row(name: str, take: Motion, whole: Database, settings: SolveSettings, folder: Path) -> dict[str, Any]:
    """Return a take's error with all subjects but this take, and with each half.

    Its own subject stays in both.
    """
    own = subject_of(name)
    start = max((take.frames - FRAMES) // 2, 0)
    truth = sliced(take, start, min(start + FRAMES, take.frames))
    others = sorted({clip.subject for clip in whole.clips} - {own})
    np.random.default_rng(_SEED).shuffle(others)
    kept = {"all": others} | {f"half_{number}": others[number::HALVES] for number in range(HALVES)}
    errors: dict[str, float | None] = dict.fromkeys(kept)
    for part, subjects in kept.items():
        chosen = {own, *subjects}
        clips = [(c, 0, c.stop - c.start) for c in whole.clips if c.name != name and c.subject in chosen]
        if not clips:  # the take is its subject's only one, and there is one other subject: a half is empty
            continue
        database = write_subset(whole, folder / "more-data.pfdb", clips)
        errors[part] = float(degrees_per_joint(solve_truth(truth, database, settings)[0], truth).mean())
    whole_error, *halves = (error for error in errors.values() if error is not None)
    return {
        "take": name,
        "frames": truth.frames,
        **{f"deg_per_joint_{part}": error and round(error, 4) for part, error in errors.items()},
        "ratio": round(whole_error / min(halves), 4) if halves else 1.0,
    }
