"""Shipped performances of the simulated performer.

Each file in assets/performances contains a T pose and one behaviour, made by tools/motion_synthesis. None of them is in
the embedded motion database, which only contains similar motion.
"""

from dataclasses import replace

import numpy as np

from ..body.mirroring import mirrored_points, mirrored_rotations, mirrored_skeleton
from ..body.motion import LEAST_FPS, MOST_FPS, Motion, eased_between, resampled, sliced
from ..body.skeleton import Skeleton
from ..body.standard_skeleton import default_skeleton
from ..errors import SettingsError
from ..geometry import rotations as rot
from ..system.assets import PERFORMANCES

DEMO = "demo"
BEHAVIOURS = ("walking", "running", "hopping", "jumping", "boxing", "kendo")
T_POSE_S = 2.0  # duration of the T pose at the start of each performance
RADIANS_A_STEP = np.pi / 32767  # rotation vectors are stored as 16-bit integers: 0.005 degrees
METRES_A_STEP = 1e-4
_LEAST_S = 5.0
_MOST_FRAMES = 300_000  # takes 280 MB and lasts 83 minutes at 60 Hz


def load_performance(behaviour: str) -> tuple[Motion, int]:
    """Return a shipped performance and its first frame after the T pose.

    Args:
        behaviour: "demo", one of `BEHAVIOURS`, or the beginning of such a name ("walk").

    Raises:
        SettingsError: No name begins with this text, or several do.
    """
    fitting = [name for name in (DEMO, *BEHAVIOURS) if name.startswith(behaviour)]
    if len(fitting) != 1:
        names = ", ".join((DEMO, *BEHAVIOURS))
        raise SettingsError(f"unknown behaviour {behaviour!r}", advice=f"choose one of {names}")
    with np.load(PERFORMANCES / f"{fitting[0]}.npz", allow_pickle=False) as arrays:
        vectors = RADIANS_A_STEP * np.cumsum(arrays["rotation_steps"], axis=0, dtype=np.int16).astype(np.float64)
        roots = METRES_A_STEP * np.cumsum(arrays["root_steps"], axis=0, dtype=np.int32).astype(np.float64)
        plain = default_skeleton()
        skeleton = replace(plain, offsets_m=arrays["offsets_m"], tips_m=arrays["tips_m"])
        motion = Motion(fitting[0], float(arrays["fps"]), skeleton, rot.from_rotation_vector(vectors), roots)
        return motion, int(arrays["behaviour_start"])


def performance(
    behaviour: str,
    seconds: float | None = None,
    fps: float = 60.0,
    skeleton: Skeleton | None = None,
    mirrored: bool = False,
    at_once: bool = False,
) -> Motion:
    """Return a performance, a T pose followed by a behaviour, with a given duration and body.

    Args:
        seconds: Duration of the whole motion, to which the behaviour is cut or repeated; None keeps it as shipped.
        skeleton: Skeleton with the standard joints; None keeps the performance's own skeleton.
        mirrored: Swap left and right.
        at_once: Leave the T pose out.

    Raises:
        SettingsError: The behaviour is unknown, or the duration or the frame rate is out of range.
    """
    if not LEAST_FPS <= fps <= MOST_FPS:
        advice = f"use {LEAST_FPS:g} to {MOST_FPS:g} frames per second"
        raise SettingsError(f"the frame rate {fps:g} is out of range", advice=advice)
    motion, start = load_performance(behaviour)
    if at_once:
        motion, start = sliced(motion, start, motion.frames), 0
    if mirrored:
        motion = replace(
            motion,
            skeleton=mirrored_skeleton(motion.skeleton),
            rotations=mirrored_rotations(motion.rotations),
            root_positions_m=mirrored_points(motion.root_positions_m),
        )
    if skeleton is not None:
        scale = _sole_depth_m(skeleton) / _sole_depth_m(motion.skeleton)
        motion = replace(motion, skeleton=skeleton, root_positions_m=scale * motion.root_positions_m)
    if seconds is not None:
        most_s = _MOST_FRAMES / max(fps, motion.fps)
        if not _LEAST_S <= seconds <= most_s:
            kind = "short" if seconds < _LEAST_S else "long"
            advice = f"give {_LEAST_S:.0f} to {most_s:.0f} s"
            raise SettingsError(f"a performance of {seconds:.6g} s is too {kind}", advice=advice)
        motion = _lasting(motion, start, seconds)
    return resampled(motion, fps)


def with_return(motion: Motion) -> Motion:
    """Return the motion with a smooth transition back to its first pose within 1.5 s, so that it can be repeated."""
    last, first = ((motion.rotations[frame], motion.root_positions_m[frame]) for frame in (-1, 0))
    back, way = eased_between(last, first, max(round(1.5 * motion.fps), 1))
    return replace(
        motion,
        rotations=np.concatenate((motion.rotations, back)),
        root_positions_m=np.concatenate((motion.root_positions_m, way)),
    )


def _lasting(motion: Motion, start: int, seconds: float) -> Motion:
    """Return the motion cut, or repeated from frame `start` on, to a duration of `seconds`."""
    frames = round(seconds * motion.fps) + 1
    if frames > motion.frames:
        again = with_return(sliced(motion, start, motion.frames))
        repeats = -(-(frames - start) // again.frames)
        motion = replace(
            motion,
            rotations=np.concatenate((motion.rotations[:start], *(again.rotations,) * repeats)),
            root_positions_m=np.concatenate((motion.root_positions_m[:start], *(again.root_positions_m,) * repeats)),
        )
    return sliced(motion, 0, frames)


def _sole_depth_m(skeleton: Skeleton) -> float:
    """Return the height of the root above the lowest joint in the rest pose."""
    return float(-skeleton.rest_positions_m[:, 1].min())
