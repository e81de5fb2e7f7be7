"""Check a walk and boxing on every character below a folder.

    python tools/retarget_bench.py --data ../shared/data/rigs

Every file that Blender reads (.glb, .gltf, .vrm, .blend) gets a line: how far its arms hang in the rest pose, whether
the bone map is complete, by which method it was found, and for each clip the largest median angle between the direction
of a hand, a foot or an arm's bone and the performer's, the fastest turn of a bone relative to the performer's fastest
joint, and the extra speed of feet while the performer's stand. Refused files are printed with the reason. The exit
status is 1 if a character misses the limits: 3 degrees, twice the turn, 1 cm/s.
"""

import argparse
import contextlib
import io
import os
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from perfanim.core.body.motion import Motion, sliced
from perfanim.core.errors import PerfanimError
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.system.assets import MOTION
from perfanim.perfanim_addon.export.retarget_file import retarget_file

sys.path.append(str(Path(__file__).resolve().parents[1] / "tests" / "helpers"))

from retargeted import Played, measured

ENDINGS = (".glb", ".gltf", ".vrm", ".blend")
CLIPS = ("walking-01-neutral", "boxing-01-neutral")
FRAMES = 180
SCENE_FPS = 24.0  # a .blend keeps its own rate: each frame of the motion on one of the scene's
DIRECTION_DEG, TURN, SLIDE_CM_S = 3.0, 2.0, 1.0


def main() -> int:
    """Run; return 1 if a character misses the limits."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="folder with characters")
    options = parser.parse_args()
    missed = 0
    for path in sorted(path for path in options.data.rglob("*") if path.suffix.lower() in ENDINGS):
        name = path.relative_to(options.data)
        try:
            found = [_retargeted(path, clip) for clip in CLIPS]
        except PerfanimError as error:
            _say(f"{name}: refused: {str(error).partition(': ')[2]}")
            continue
        done, first = found[0]
        complete = "complete" if done["complete"] else "without " + ", ".join(done["unmapped"])
        doubtful = f", doubtful: {', '.join(done['doubtful'])}" if done["doubtful"] else ""
        _say(f"{name}: arms {first.arms_down_deg:.0f} deg down, {complete}{doubtful}, by {done['found_by']}")
        for clip, (_, figures) in zip(CLIPS, found, strict=True):
            missed += _report(clip, figures)
    _say(f"{missed} missed")
    return 1 if missed else 0


def _retargeted(path: Path, clip: str) -> tuple[dict[str, Any], Played]:
    motion = sliced(read_motion(MOTION / f"{clip}.bvh"), 0, FRAMES)
    if path.suffix == ".blend":
        motion = Motion(motion.name, SCENE_FPS, motion.skeleton, motion.rotations, motion.root_positions_m)
    with tempfile.TemporaryDirectory() as folder, _silent():
        done = retarget_file(motion, path, Path(folder) / "out.blend")
        return done, measured(done, motion)


def _report(clip: str, figures: Played) -> bool:
    """Print a line; return True if it misses the limits."""
    medians = {limb: float(np.median(errors)) for limb, errors in figures.direction_deg.items()}
    worst = max(medians, key=lambda limb: medians[limb])
    turn = figures.turn_deg / figures.own_turn_deg
    slide = figures.slide_cm_s - figures.own_slide_cm_s
    _say(f"  {clip}: {medians[worst]:.2f} deg ({worst}), turn {turn:.2f}, slide {slide:+.2f} cm/s")
    return medians[worst] > DIRECTION_DEG or turn > TURN or slide > SLIDE_CM_S


def _say(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


@contextlib.contextmanager
def _silent():  # type: ignore[no-untyped-def]
    """Hide output of Blender's importers, from Python and below."""
    sys.stdout.flush()
    kept, nowhere = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nowhere)


if __name__ == "__main__":
    sys.exit(main())
