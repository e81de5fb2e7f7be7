"""Make the embedded motion database and body prototypes.

    python -m motion_synthesis.make_assets OUT

The same command gives the same files, byte for byte.
"""

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from perfanim.core.body.motion import Motion, sliced
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.errors import PerfanimError
from perfanim.core.formats.motion.bvh import write_bvh
from perfanim.core.geometry import rotations as rot
from perfanim.core.simulate.performance import BEHAVIOURS, DEMO, METRES_A_STEP, RADIANS_A_STEP, T_POSE_S

from .bodies import body, prototype_bodies, save_bodies
from .performance import ARMS_DOWN_S, DEMO_STREAM, demo_performance, perform, performance
from .style import STYLES

FPS = 60.0
_CLIP_S = 5.4
_DECIMALS = 2  # of degrees and centimetres
_DEMO_S = 21.0
_PERFORMANCE_S = 18.0
_T_POSE_LEFT_S = 0.4  # of the T pose at the start of a clip with transitions


@dataclass(frozen=True)
class Clip:
    """One clip of the database.

    Behaviours with their seconds, style, body (height, build, person), seed.
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
_REPEATS = {"walking": 9, "running": 7, "hopping": 6, "jumping": 7, "boxing": 9, "kendo": 8}
_SECONDS = {"boxing": 6.4, "kendo": 6.6, "walking": 5.2}
_LONG_WALK_S = 9.6  # long enough for circles and turning round
_TURNING_SEEDS = (1102, 1120, 1101, 1155)  # of the last walks: round by the left, a circle, and the same by the right


def clips() -> list[Clip]:
    """Return the clips of the embedded database."""
    result = []
    for kind, (behaviour, repeats) in enumerate(_REPEATS.items()):
        for i in range(repeats):
            style = _STYLES[(i + 3 * kind) % len(_STYLES)]
            person = _BODIES[(i + kind) % len(_BODIES)]
            seconds, seed = _SECONDS.get(behaviour, _CLIP_S), 1000 * (kind + 1) + i
            turn = i - (repeats - len(_TURNING_SEEDS))
            if behaviour == "walking" and turn >= 0:
                seconds, seed = _LONG_WALK_S, _TURNING_SEEDS[turn]
            script = ((behaviour, seconds),)
            result.append(Clip(f"{behaviour}-{i + 1:02d}-{style}", script, style, person, seed))
    for i, chain in enumerate(_CHAINS):
        style = _STYLES[(2 * i + 1) % len(_STYLES)]
        person = _BODIES[(3 * i) % len(_BODIES)]
        name = "-".join(["transition", f"{i + 1:02d}", *(behaviour for behaviour, _ in chain)])
        result.append(Clip(name, chain, style, person, 9000 + i))
    return result


def motion_of(clip: Clip) -> Motion:
    """Return the motion of a clip; those with transitions begin in the T pose."""
    skeleton, style = body(*clip.body), STYLES[clip.style]
    if len(clip.script) == 1:
        behaviour, seconds = clip.script[0]
        return perform(behaviour, seconds, FPS, skeleton, style, clip.seed)
    motion = performance(clip.script, FPS, skeleton, style, clip.seed, clip.name)
    return sliced(motion, round((T_POSE_S - _T_POSE_LEFT_S) * FPS), motion.frames)


def make_assets(out: Path, progress: Callable[[float, str], None]) -> dict[str, float]:
    """Write motion/*.bvh, performances/*.npz, skeletons.json in `out`; return counts.

    Raises:
        PerfanimError: the folder cannot be written.
    """
    folder = out / "motion"
    folder.mkdir(parents=True, exist_ok=True)
    frames, planned = 0, clips()
    for i, clip in enumerate(planned):
        progress(i / len(planned), clip.name)
        frames += write_clip(clip, folder).frames
    save_bodies(prototype_bodies(), out / "skeletons.json")
    (out / "performances").mkdir(exist_ok=True)
    for name in (DEMO, *BEHAVIOURS):
        progress(1.0, f"performance {name}")
        write_performance(name, out / "performances" / f"{name}.npz")
    size = sum(path.stat().st_size for path in folder.glob("*.bvh"))
    return {"clips": len(planned), "seconds": frames / FPS, "bytes": size}


def write_clip(clip: Clip, folder: Path) -> Motion:
    """Write one clip as BVH in centimetres."""
    motion = motion_of(clip)
    write_bvh(motion, folder / f"{clip.name}.bvh", "cm", decimals=_DECIMALS)
    return motion


def write_performance(name: str, path: Path) -> Motion:
    """Write a motion of the simulated performer.

    Seeds and bodies differ from those of the embedded motion.
    """
    if name == DEMO:
        motion = demo_performance(0, _DEMO_S)
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


def main(arguments: list[str] | None = None) -> int:
    """Run the command; return its exit status."""
    parser = argparse.ArgumentParser(prog="make_assets", description="make the embedded motion database")
    parser.add_argument("out", type=Path, help="folder to which motion/*.bvh and skeletons.json are written")
    args = parser.parse_args(arguments)

    def progress(fraction: float, text: str) -> None:
        sys.stderr.write(f"{100.0 * fraction:3.0f} % {text}\n")

    try:
        counts = make_assets(args.out, progress)
    except (PerfanimError, OSError) as error:
        sys.stderr.write(f"{error}\n")
        return 1
    megabytes = np.round(counts["bytes"] / 1e6, 1)
    sys.stdout.write(f"{counts['clips']:.0f} clips, {counts['seconds']:.0f} s, {megabytes} MB in {args.out}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
