"""Joint angles of the embedded synthetic motion compared with those of people."""

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from perfanim.core.body import skeleton as skeletons
from perfanim.core.body.joint_angle_frames import with_angle_frames
from perfanim.core.body.motion import Motion, resampled
from perfanim.core.database.file_selection import behaviour_of, subject_of
from perfanim.core.formats.motion.motion_sources import motion_files
from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.geometry.arrays import Array
from perfanim.core.system.assets import MOTION

from .run import Run
from .scenarios import CMU, LEFT_OUT, SPLIT

# kind of motion -> names of people's clips and of ours
KINDS = {
    "walking": r"^(slow |quick)?walk(ing|straight)?\b(?! (to|on|dig))",
    "running": r"^run(ning)?(/jog)?( neutral| tired| loose| proud| brisk| energetic|$)",
    "jumping": r"^(forward |high )?jump(ing)?\b(?! over| turn|ing jacks|s )|^hop",
    "boxing": r"^box",
}
_FPS = 30.0
_MOST_CLIPS = 3  # largest number of clips per person and kind
_INNER = (5.0, 50.0, 95.0)  # percentiles of an angle
_STILL_DEG = 1.0  # median range below which an angle counts as held still by people

Angles = Mapping[tuple[str, str], Array]  # angles of a joint about an axis


def joint_angles(run: Run) -> dict[str, Any]:
    """Compare medians and ranges of joint angles by kind of motion.

    The recordings exclude the test takes: whoever tunes the embedded motion with these rows must not have seen
    them. A range extends from the 5th to the 95th percentile of frames. Angles that people hold still in recordings,
    such as those of fingers and clavicles, are left out.

    Returns:
        rows (kind, joint, axis; for people and for our clips: the median, the least and the greatest of their medians,
        and the median of their ranges; outside_deg: how far our median is outside people's), people (their
        names by kind), outputs.
    """
    run.out.mkdir(parents=True, exist_ok=True)
    theirs, ours = _by_kind(run.folders((CMU,)), subject_of), _by_kind([MOTION], str)
    kinds = [kind for kind in KINDS if kind in theirs and kind in ours]
    rows: list[dict[str, Any]] = []
    for kind in kinds:
        sides = [[_percentiles(clips) for clips in side[kind].values()] for side in (theirs, ours)]
        rows += sorted(_compared(kind, *sides), key=lambda row: -row["outside_deg"])
    people = {kind: sorted(theirs[kind]) for kind in kinds}
    return run.write("joint-angles", {"rows": rows, "people": people}, {"": rows})


def _by_kind(folders: Sequence[Path], performer: Callable[[str], str]) -> dict[str, dict[str, list[Angles]]]:
    """Return the angles of clips by kind and performer."""
    found: dict[str, dict[str, list[Angles]]] = {}
    with motion_files(folders) as files:
        for file in files:
            behaviour = behaviour_of(file.stem, file.description).lower()
            for kind, pattern in KINDS.items():
                if file.stem not in (*LEFT_OUT, SPLIT) and re.search(pattern, behaviour):
                    clips = found.setdefault(kind, {}).setdefault(performer(file.stem), [])
                    if len(clips) < _MOST_CLIPS:
                        clips.append(_angles(resampled(read_motion(file.path, file.skeleton), _FPS)))
    return found


def _angles(motion: Motion) -> Angles:
    """Return the angles (F,) of a motion in degrees, except the root's."""
    skeleton = with_angle_frames(motion.skeleton)
    columns = zip(
        skeleton.names, skeleton.angle_orders, skeletons.joint_angles(skeleton, motion.rotations), strict=True
    )
    return {
        (name, axis): np.degrees(angles[:, column])
        for name, order, angles in list(columns)[1:]
        for column, axis in enumerate(order)
    }


def _percentiles(clips: Sequence[Angles]) -> Angles:
    """Return the percentiles (3,) of one performer's angles."""
    return {angle: np.percentile(np.concatenate([clip[angle] for clip in clips]), _INNER) for angle in clips[0]}


def _compared(kind: str, theirs: Sequence[Angles], ours: Sequence[Angles]) -> Iterator[dict[str, Any]]:
    """Yield a row for each angle that moves in people's recordings."""
    for joint, axis in theirs[0]:
        them, us = (np.array([each[joint, axis] for each in side]) for side in (theirs, ours))
        if np.median(np.ptp(them, axis=1)) < _STILL_DEG:
            continue
        row: dict[str, Any] = {"kind": kind, "joint": joint, "axis": axis}
        for name, side in (("people", them), ("ours", us)):
            medians, ranges = side[:, 1], side[:, 2] - side[:, 0]
            figures = {
                "": np.median(medians),
                "_least": medians.min(),
                "_most": medians.max(),
                "_range": np.median(ranges),
            }
            row |= {f"{name}{what}_deg": round(float(value), 1) for what, value in figures.items()}
        middle = float(np.median(us[:, 1]))
        off = max(float(them[:, 1].min()) - middle, middle - float(them[:, 1].max()), 0.0)
        yield row | {"outside_deg": round(off, 1)}
