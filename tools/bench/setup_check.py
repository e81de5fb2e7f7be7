"""How often the setup check names the right fault in random studios."""

from collections import Counter
from typing import Any

import numpy as np
from perfanim.core.simulate.practice_studio import board_views, studio_with
from perfanim.core.subjects.setup_check.board_faults import board_faults
from perfanim.core.subjects.setup_check.find_faults import check_setup
from perfanim.core.subjects.setup_check.finding import Fault
from perfanim.core.vision.detection.background import learn_backgrounds

from .run import Run

HEALTHY = "healthy"


def setup_check(run: Run, studios: int = 12, seed: int = 71) -> dict[str, Any]:
    """Check random studios: a number of each fault, and of faultless ones.

    A studio counts as right if exactly its own fault is named; a faultless one if none is.

    Returns:
        rows (kind of studio, right, studios, what was named instead), wrong, outputs.
    """
    run.out.mkdir(parents=True, exist_ok=True)
    kinds = (HEALTHY, *Fault)
    rows: list[dict[str, Any]] = []
    for number, kind in enumerate(kinds):
        run.progress(number / len(kinds), kind)
        right = () if kind == HEALTHY else (kind,)
        counts = Counter(named(kind, np.random.default_rng([seed, number, n])) for n in range(studios))
        others = {" + ".join(found) or "none": count for found, count in counts.items() if found != right}
        instead = ", ".join(f"{count} {name}" for name, count in others.items())
        rows.append({"kind": str(kind), "right": counts[right], "studios": studios, "instead": instead})
    wrong = sum(row["studios"] - row["right"] for row in rows)
    return run.write("setup-check", {"rows": rows, "wrong": wrong}, {"": rows})


def named(kind: str, rng: np.random.Generator) -> tuple[str, ...]:
    """Return the faults that the check names in a random studio of a given kind."""
    if kind == Fault.BOARD_SMALL or (kind == HEALTHY and rng.random() < 0.2):
        findings = board_faults(*board_views(rng, small=kind != HEALTHY))
    else:
        studio = studio_with(None if kind == HEALTHY else Fault(kind), rng)
        backgrounds = learn_backgrounds(studio.empty)
        findings = check_setup(studio.rig, backgrounds, studio.moments, studio.marker_set, studio.height_m)
    return tuple(sorted({finding.fault for finding in findings}))
