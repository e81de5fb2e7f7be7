"""Two performers that pass, touch or embrace: how long labels stay wrong."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from perfanim.core.body.motion import Motion, sliced
from perfanim.core.body.scene_pose import PerformerPose
from perfanim.core.database.store import Database
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.arrays import Array, runs
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.session.multi_target_session import MultiTargetSession
from perfanim.core.session.session import Session
from perfanim.core.solver.settings import SolveSettings

from .data import FPS
from .figure6 import true_subject
from .random_cuts import facing, markers_of

_FRAMES = 150
_APART_M = (0.3, 0.9)  # between the middles of the bodies when they are nearest
_WALK_M = 1.0  # that a take must move over the ground to be one of these
_STAY_M = 0.5  # that it may move to be in place
_NEAR_M = (0.15, 0.3)  # between hands, or middles of torsos, of two who meet
_STEPS_M = 1.2  # by which they are further apart before and after
_MEETING = (15, 45, 105, 135)  # frames at which they begin to come, have come, go, and are gone
_NOISE_M = 0.002
_WRONG_M = 0.03  # a marker so far from its true place has a wrong label


class Crossing(NamedTuple):
    """Markers (F, M, 3) of two performers of the same body.

    Args:
        apart_m: smallest distance between the middles of the bodies, or between what meets.
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


def meetings(takes: Mapping[str, Motion], count: int, generator: np.random.Generator) -> Iterator[Crossing]:
    """Yield pairs of takes in place, on one body, that face each other and come near.

    For a second, right hands touch in every other pair, and torsos in the others.
    """
    stays = {name: stay for name, take in takes.items() for stay in [_stay(take)] if stay is not None}
    share = np.interp(np.arange(_FRAMES), _MEETING, (0.0, 1.0, 1.0, 0.0))
    steps_m = _STEPS_M * (1.0 - share**2 * (3.0 - 2.0 * share))
    for number in range(count if len(stays) > 1 else 0):
        first, second = (str(name) for name in generator.choice(list(stays), 2, replace=False))
        motion, near_m = stays[first], float(generator.uniform(*_NEAR_M))
        markers = true_subject(motion).marker_set.markers
        met = [marker.name == "RHAN" if number % 2 else marker.torso for marker in markers]
        seen = []
        for name, heading in ((first, 0.5 * np.pi), (second, -0.5 * np.pi)):
            shown = markers_of(facing(replace(stays[name], skeleton=motion.skeleton), heading, np.zeros(3)))
            middle = shown[_FRAMES // 2, met].mean(axis=0) * (1.0 if number % 2 else np.array([1.0, 0.0, 1.0]))
            seen.append(shown - middle)
        seen[1] += np.array([1.0, 0.0, 0.0]) * (near_m + steps_m)[:, None, None]
        kind = "hands" if number % 2 else "torsos"
        yield Crossing(f"{first} + {second}, {kind}", motion, (seen[0], seen[1]), near_m)


def _stay(take: Motion) -> Motion | None:
    """Return the middle of a take that stays in its place, else None."""
    if take.frames < _FRAMES:
        return None
    start = (take.frames - _FRAMES) // 2
    part = sliced(take, start, start + _FRAMES)
    return part if float(np.ptp(part.root_positions_m[:, [0, 2]], axis=0).max()) < _STAY_M else None


def _walk(take: Motion) -> Motion | None:
    """Return the middle of a take that walks far enough, else None."""
    if take.frames < _FRAMES:
        return None
    start = (take.frames - _FRAMES) // 2
    part = sliced(take, start, start + _FRAMES)
    gone = part.root_positions_m[-1] - part.root_positions_m[0]
    forward = rot.rotate(part.rotations[0, 0], np.array([0.0, 0.0, 1.0]))
    return part if float(np.dot(gone, forward)) > _WALK_M else None


def play_crossing(
    crossing: Crossing, database: Database, settings: SolveSettings, generator: np.random.Generator
) -> dict[str, Any]:
    """Show both performers' markers without labels to a new session; return the row.

    Both have the same body, so the first frame that shows both decides who is who.
    """
    subject = true_subject(crossing.motion)
    session = MultiTargetSession([Session(subject, database, settings=settings) for _ in range(2)])
    wrong, exchanged, turned = [], [], None
    for number, shown in enumerate(zip(*crossing.markers_m, strict=True)):
        points = np.concatenate(shown)
        points = generator.permutation(points + generator.normal(0.0, _NOISE_M, points.shape))
        covariances = np.broadcast_to(_NOISE_M**2 * np.eye(3), (len(points), 3, 3))
        poses = session.step(MarkerFrame(number, number / FPS, points, covariances)).performers
        if turned is None and all(np.isfinite(pose.observed_m).any() for pose in poses):
            turned = _are_turned(poses, shown)
        shown = shown[::-1] if turned else shown
        away = [np.linalg.norm(pose.observed_m - true, axis=1) for pose, true in zip(poses, shown, strict=True)]
        wrong.append(any(np.any(distances > _WRONG_M) for distances in away))
        apart = [np.linalg.norm(pose.observed_m[:, None] - other, axis=2)
                 for pose, other in zip(poses, shown[::-1], strict=True)]  # fmt: skip
        exchanged.append(any(np.any((near < _WRONG_M) & (own > _WRONG_M)[:, None])
                             for near, own in zip(apart, away, strict=True)))  # fmt: skip
    return {
        "crossing": crossing.title,
        "apart_m": round(crossing.apart_m, 3),
        "wrong_frames": int(np.sum(wrong)),
        "longest_wrong_s": _longest_s(wrong),
        "longest_exchanged_s": _longest_s(exchanged),
        "frames": len(wrong),
    }


def _are_turned(poses: Sequence[PerformerPose], shown: Sequence[Array]) -> bool:
    """Return whether the first performer's markers are those shown second."""
    middles = [np.nanmean(pose.observed_m, axis=0) for pose in poses]
    straight, turned = (
        sum(np.linalg.norm(middle - markers.mean(axis=0)) for middle, markers in zip(middles, order, strict=True))
        for order in (shown, shown[::-1])
    )
    return bool(turned < straight)


def _longest_s(frames: list[bool]) -> float:
    longest = max((stop - start for start, stop in runs(np.array(frames))), default=0)
    return round(longest / FPS, 4)
