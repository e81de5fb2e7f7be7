"""Make the embedded motion database, the performances and the body prototypes.

    python -m motion_synthesis.make_assets OUT  # in tools/

The same command produces identical files, byte for byte.
"""

import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
from perfanim.core.body.motion import Motion, sliced
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.formats.motion.bvh import write_bvh
from perfanim.core.geometry import rotations as rot
from perfanim.core.simulate.shipped_performance import BEHAVIOURS, DEMO, METRES_A_STEP, RADIANS_A_STEP, T_POSE_S

from .bodies import body, prototype_bodies, save_bodies
from .performance import ARMS_DOWN_S, DEMO_STREAM, demo_performance, perform, performance
from .style import STYLES

FPS = 60.0
_DECIMALS = 2  # decimals of degrees and centimetres
_DEMO_S, _PERFORMANCE_S = 21.0, 18.0
_T_POSE_LEFT_S = 0.4  # part of the T pose kept at the start of a clip with transitions


class Clip(NamedTuple):
    """One clip of the database.

    Args:
        script: Behaviours with their durations in seconds.
        body: Height, build, person.
    """

    name: str
    script: tuple[tuple[str, float], ...]
    style: str
    body: tuple[float, float, int]
    seed: int


# (height, build, person)
_BODIES = (
    (1.75, 0.0, 0), (1.68, -0.5, 11), (1.82, 0.4, 12), (1.62, 0.3, 13),
    (1.88, -0.3, 14), (1.71, 0.8, 15), (1.79, -0.8, 16), (1.56, 0.0, 17),
)  # fmt: skip
_STYLES = ("neutral", "energetic", "relaxed", "brisk", "neutral", "tired", "loose", "proud")
_CHAINS = (
    (("walking", 4.0), ("boxing", 4.5)),
    (("running", 3.2), ("jumping", 4.2)),
    (("kendo", 5.0), ("walking", 3.5)),
    (("hopping", 3.6), ("running", 3.6)),
    (("jumping", 3.6), ("hopping", 3.6)),
    (("boxing", 4.5), ("kendo", 5.0)),
)
# repetitions and seconds
_REPEATS = {
    "walking": (9, 5.2), "running": (7, 5.4), "hopping": (6, 5.4), "jumping": (7, 5.4), "boxing": (9, 6.4),
    "kendo": (8, 6.6),
}  # fmt: skip
_LONG_WALK_S = 9.6  # long enough for circles and turning round
_TURNING_SEEDS = (1102, 1120, 1101, 1155)  # the last walks turn to the left, walk a circle, and do both to the right


def clips() -> list[Clip]:
    """Return the clips of the embedded database."""
    result = []
    for kind, (behaviour, (repeats, usual_s)) in enumerate(_REPEATS.items()):
        for i in range(repeats):
            style = _STYLES[(i + 3 * kind) % len(_STYLES)]
            seconds, seed = usual_s, 1000 * (kind + 1) + i
            turn = i - (repeats - len(_TURNING_SEEDS))
            if behaviour == "walking" and turn >= 0:
                seconds, seed = _LONG_WALK_S, _TURNING_SEEDS[turn]
            person = _BODIES[(i + kind) % len(_BODIES)]
            result.append(Clip(f"{behaviour}-{i + 1:02d}-{style}", ((behaviour, seconds),), style, person, seed))
    for i, chain in enumerate(_CHAINS):
        name = "-".join(["transition", f"{i + 1:02d}", *(behaviour for behaviour, _ in chain)])
        style, person = _STYLES[(2 * i + 1) % len(_STYLES)], _BODIES[(3 * i) % len(_BODIES)]
        result.append(Clip(name, chain, style, person, 9000 + i))
    return result


def motion_of(clip: Clip) -> Motion:
    """Return the motion of a clip; clips with transitions begin in the T pose."""
    skeleton, style = body(*clip.body), STYLES[clip.style]
    if len(clip.script) == 1:
        behaviour, seconds = clip.script[0]
        return perform(behaviour, seconds, FPS, skeleton, style, clip.seed)
    motion = performance(clip.script, FPS, skeleton, style, clip.seed, clip.name)
    return sliced(motion, round((T_POSE_S - _T_POSE_LEFT_S) * FPS), motion.frames)


def write_clip(clip: Clip, folder: Path) -> None:
    """Write one clip as BVH in centimetres."""
    write_bvh(motion_of(clip), folder / f"{clip.name}.bvh", "cm", decimals=_DECIMALS)


def write_performance(name: str, path: Path) -> Motion:
    """Write a motion of the simulated performer, with other seeds and bodies than in the embedded motion."""
    if name == DEMO:
        motion = demo_performance(_DEMO_S)
    else:
        seed = DEMO_STREAM + 1 + BEHAVIOURS.index(name)
        motion = performance([(name, _PERFORMANCE_S)], FPS, default_skeleton(), STYLES["neutral"], seed, name)
    steps = np.round(rot.to_rotation_vector(motion.rotations) / RADIANS_A_STEP).astype(np.int16)
    roots = np.round(motion.root_positions_m / METRES_A_STEP).astype(np.int32)
    np.savez_compressed(
        path,
        fps=motion.fps,
        behaviour_start=round((T_POSE_S + ARMS_DOWN_S) * motion.fps),
        rotation_steps=np.diff(steps, axis=0, prepend=np.zeros_like(steps[:1])),
        root_steps=np.diff(roots, axis=0, prepend=np.zeros_like(roots[:1])),
        offsets_m=motion.skeleton.offsets_m,
        tips_m=motion.skeleton.tips_m,
    )
    return motion


def make_assets(out: Path) -> None:
    """Write motion/*.bvh, performances/*.npz and skeletons.json to `out`."""
    for folder in ("motion", "performances"):
        (out / folder).mkdir(parents=True, exist_ok=True)
    for clip in clips():
        write_clip(clip, out / "motion")
    save_bodies(prototype_bodies(), out / "skeletons.json")
    for name in (DEMO, *BEHAVIOURS):
        write_performance(name, out / "performances" / f"{name}.npz")


if __name__ == "__main__":
    make_assets(Path(sys.argv[1]))
