"""Count how often the check names the right fault of random studios.

    python tools/setup_check_bench.py [--studios N] [--seed N] [FAULT...]

A studio counts as right if its own fault, and no other, is named; a healthy one if none is.
"""

import argparse
import sys
from collections import Counter

import numpy as np
from perfanim.core.simulate.practice_studio import board_views, studio_with
from perfanim.core.subjects.setup_check.board_faults import board_faults
from perfanim.core.subjects.setup_check.find_faults import check_setup
from perfanim.core.subjects.setup_check.finding import Fault
from perfanim.core.vision.detection.background import learn_backgrounds

HEALTHY = "healthy"
KINDS = (HEALTHY, *Fault)


def named(kind: str, rng: np.random.Generator) -> tuple[str, ...]:
    """Return the faults that are named in a random studio of a kind."""
    if kind == Fault.BOARD_SMALL or (kind == HEALTHY and rng.random() < 0.2):
        findings = board_faults(*board_views(rng, small=kind != HEALTHY))
    else:
        studio = studio_with(None if kind == HEALTHY else Fault(kind), rng)
        backgrounds = learn_backgrounds(studio.empty)
        findings = check_setup(studio.rig, backgrounds, studio.moments, studio.marker_set, studio.height_m)
    return tuple(sorted({finding.fault for finding in findings}))


def main() -> int:
    """Print a line for each kind; return 1 if any studio was judged wrongly."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("kinds", nargs="*", metavar="FAULT", help="default: healthy studios and all faults")
    parser.add_argument("--studios", type=int, default=10, help="of each kind (default 10)")
    parser.add_argument("--seed", type=int, default=0, help="of the studios (default 0)")
    options = parser.parse_args()
    if unknown := set(options.kinds) - set(KINDS):
        parser.error(f"unknown: {', '.join(sorted(unknown))}; choose of {', '.join(KINDS)}")
    wrong = 0
    for kind in options.kinds or KINDS:
        right = () if kind == HEALTHY else (kind,)
        rngs = [np.random.default_rng([options.seed, KINDS.index(kind), n]) for n in range(options.studios)]
        counts = Counter(named(kind, rng) for rng in rngs)
        others = {" + ".join(found) or "none": count for found, count in counts.items() if found != right}
        wrong += sum(others.values())
        sys.stdout.write(f"{kind}: {counts[right]} of {options.studios}{f', else {others}' if others else ''}\n")
        sys.stdout.flush()
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
