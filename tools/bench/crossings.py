"""Two performers passing each other: how long their labels stay wrong."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from perfanim.core.body.motion import Motion, sliced
from perfanim.core.database.store import Database
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.arrays import Array, runs
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.session.multi_target_session import MultiTargetSession
from perfanim.core.session.session import Session

from .data import FPS
from .figure6 import true_subject
from .random_cuts import facing, markers_of

_FRAMES = 150
_APART_M = (0.3, 0.9)  # between the middles of the bodies when they are nearest
_WALK_M = 1.0  # that a take must move over the ground to be one of these
_NOISE_M = 0.002
_EXCHANGED_M = 0.03  # a marker so far from its true place is somebody else's


class Crossing(NamedTuple):
    """Markers (F, M, 3) of two performers of the same body.

    Args:
        apart_m: smallest distance between the middles of the bodies.
    """

    title: str
    motion: Motion
    markers_m: tuple[Array, Array]
    apart_m: float


def crossings(takes: Mapping[str, Motion], count: int, generator: np.random.Generator) -> Iterator[Crossing]:
    """Yield pairs of walking takes on one body that meet in the middle of the time."""
    walks = {name: walk for name, take in takes.items() for walk in [_walk(take)] if walk is not None}
    for _ in range(count if len(walks) > 1 else 0):
        first, second = (str(name) for name in generator.choice(list(walks), 2, replace=False))
        motion, apart_m = walks[first], float(generator.uniform(*_APART_M))
        paths = []
        for name, heading, aside_m in ((first, 1.0, -0.5 * apart_m), (second, -1.0, 0.5 * apart_m)):
            walk = replace(walks[name], skeleton=motion.skeleton)
            placed = facing(walk, heading * 0.5 * np.pi, np.zeros(3))
            middle = placed.root_positions_m[_FRAMES // 2] * np.array([1.0, 0.0, 1.0])
            paths.append(markers_of(placed) - middle + np.array([0.0, 0.0, aside_m]))
        yield Crossing(f"{first} x {second}", motion, (paths[0], paths[1]), apart_m)


def _walk(take: Motion) -> Motion | None:
    """Return the middle of a take that walks far enough, else None."""
    if take.frames < _FRAMES:
        return None
    start = (take.frames - _FRAMES) // 2
    part = sliced(take, start, start + _FRAMES)
    gone = part.root_positions_m[-1] - part.root_positions_m[0]
    forward = rot.rotate(part.rotations[0, 0], np.array([0.0, 0.0, 1.0]))
    return part if float(np.dot(gone, forward)) > _WALK_M else None


def play_crossing(crossing: Crossing, database: Database, generator: np.random.Generator) -> dict[str, Any]:
    """Show both performers' markers without labels to a new session; return the row."""
    subject = true_subject(crossing.motion)
    session = MultiTargetSession([Session(subject, database) for _ in range(2)])
    wrong = []
    for number, shown in enumerate(zip(*crossing.markers_m, strict=True)):
        points = np.concatenate(shown)
        points = generator.permutation(points + generator.normal(0.0, _NOISE_M, points.shape))
        covariances = np.broadcast_to(_NOISE_M**2 * np.eye(3), (len(points), 3, 3))
        poses = session.step(MarkerFrame(number, number / FPS, points, covariances)).performers
        away = [np.linalg.norm(pose.observed_m - true, axis=1) for pose, true in zip(poses, shown, strict=True)]
        wrong.append(any(np.any(distances > _EXCHANGED_M) for distances in away))
    longest = max((stop - start for start, stop in runs(np.array(wrong))), default=0)
    return {
        "crossing": crossing.title,
        "apart_m": round(crossing.apart_m, 3),
        "wrong_frames": int(np.sum(wrong)),
        "longest_wrong_s": round(longest / FPS, 4),
        "frames": len(wrong),
    }
