"""Unlabelled markers: cuts between takes, absences, performers who pass or meet; when labels are correct again."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from perfanim.core.body.calibration_poses import t_pose
from perfanim.core.body.motion import Motion, sliced
from perfanim.core.body.scene_pose import DOUBTFUL, PerformerPose
from perfanim.core.body.skeleton import Skeleton
from perfanim.core.database.store import Database
from perfanim.core.geometry import rotations as rot
from perfanim.core.geometry.arrays import Array, Mask, runs
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.session.multi_target_session import MultiTargetSession
from perfanim.core.session.session import Session
from perfanim.core.session.solve_take import solve_frames
from perfanim.core.simulate.studio.studio_rig import default_rig
from perfanim.core.solver.settings import SolveSettings
from perfanim.core.system.progress import no_progress

from .scenarios import FPS
from .solving import markers_of, true_subject

BEFORE, AFTER = 45, 75  # frames of a cut's two takes
_UNSOLVABLE = ("49_21",)  # hangs on ropes, which no one does in the database
_T_POSE_EVERY = 3  # step between the cuts that start from a T pose
_GHOST_SPREAD_M = 0.7
_RIGHT_M = 0.02  # largest distance of a correctly labelled marker from its true position
_STEADY = 10  # consecutive frames that must be correct
_WAY, _SPEED_M_S = 120, 1.4  # frames and speed of the walk out of the images and back in
_PAIR_FRAMES = 150
_PASS_M, _MEET_M = (0.3, 0.9), (0.15, 0.3)  # smallest distance of two bodies that pass; of hands or torsos that meet
_WALK_M, _STAY_M = 1.0, 0.5  # smallest distance covered in a take that walks; largest in one that stays in place
_STEPS_M, _MEETING = (
    1.2,
    (15, 45, 105, 135),
)  # distance walked towards each other; frames at which they start to approach, have met, leave, are gone
_WRONG_M = 0.03  # distance of a wrongly labelled marker in a pair
_FORWARD, _LEVEL = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 1.0])


class Absence(NamedTuple):
    """Number of hidden frames between takes; largest rotation and shift of the second take."""

    hidden: tuple[int, ...] = (0, 12, 30, 60, 300)
    turn_rad: float = 1.2
    shift_m: float = 0.5


_SHORT = Absence()
LONG = Absence((120, 180, 240, 300), 1.5, 1.0)


class Faults(NamedTuple):
    """Noise, metres; share of lost markers; share of frames with ghosts, and the most ghosts in one."""

    noise_m: float = 0.002
    lost: float = 0.03
    ghost_frames: float = 0.1
    ghosts: int = 1


USUAL = Faults()


@dataclass(frozen=True)
class Cut:
    """Markers of one take, then none, then those of another take on the same body."""

    title: str
    subject: str  # name of the take from which the body comes
    skeleton: Skeleton
    positions_m: Array  # (F, M, 3) true positions, NaN while hidden
    hidden: int = 0  # frames between the takes
    back: int = 0  # first frame that must have correct labels


def random_cuts(
    takes: Mapping[str, Motion], count: int, generator: np.random.Generator, absence: Absence = _SHORT
) -> Iterator[Cut]:
    """Yield cuts between any two takes; the body is always the first take's."""
    pools = [
        [name for name, take in takes.items() if take.frames >= frames and name not in _UNSOLVABLE]
        for frames in (BEFORE, AFTER)
    ]
    for number in range(count):
        first = str(generator.choice(pools[0]))
        second = str(generator.choice([name for name in pools[1] if name != first]))
        skeleton, hidden = takes[first].skeleton, int(generator.choice(absence.hidden))
        before, after = (part_of(takes[name], frames, generator) for name, frames in ((first, BEFORE), (second, AFTER)))
        is_t_pose = number % _T_POSE_EVERY == 0
        if is_t_pose:
            before = replace(before, rotations=np.repeat(t_pose(skeleton)[None], BEFORE, axis=0))
        turn = float(generator.uniform(-absence.turn_rad, absence.turn_rad))
        x, z = generator.uniform(-absence.shift_m, absence.shift_m, 2)
        after = facing(replace(after, skeleton=skeleton), turn, np.array([x, 0.0, z]))
        seen = [markers_of(motion) for motion in (facing(before, 0.0, np.zeros(3)), after)]
        gone = np.full((hidden, *seen[0].shape[1:]), np.nan)
        positions = np.concatenate((seen[0], gone, seen[1]))
        title = f"{'T pose' if is_t_pose else first} > {second}"
        yield Cut(title, first, skeleton, positions, hidden, BEFORE + hidden)


def walk_outs(takes: Mapping[str, Motion], count: int, generator: np.random.Generator) -> Iterator[Cut]:
    """Yield up to `count` walks out of the images and back in elsewhere; the body is the first take's.

    Both cameras must show the whole body again.
    """
    names = [name for name, take in takes.items() if take.frames >= _WAY + AFTER]
    for first, second in _chosen(names, count, generator):
        away, side = int(generator.choice(LONG.hidden)), float(generator.choice((-1.0, 1.0)))
        skeleton = takes[first].skeleton
        turn, (x, z) = generator.uniform(-1.5, 1.5), generator.uniform(-0.5, 0.5, 2)
        leaving = markers_of(facing(on_treadmill(part_of(takes[first], _WAY, generator)), 0.0, np.zeros(3)))
        coming = replace(on_treadmill(part_of(takes[second], _WAY + AFTER, generator)), skeleton=skeleton)
        back = markers_of(facing(coming, turn, np.array([x, 0.0, z])))
        steps_m = side * _SPEED_M_S / FPS * np.arange(_WAY)[:, None]
        leaving[..., 0] += steps_m
        back[:_WAY, :, 0] += steps_m[::-1]
        for markers in (leaving, back):
            markers[~_shown(markers)] = np.nan
        whole = np.flatnonzero(np.isfinite(back).all(axis=(1, 2)))
        if len(whole) and whole[0] + AFTER <= len(back):
            gone = np.full((away, *back.shape[1:]), np.nan)
            positions = np.concatenate((leaving, gone, back[: whole[0] + AFTER]))
            yield Cut(f"{first}, out > {second}", first, skeleton, positions, away, _WAY + away + int(whole[0]))


def _shown(markers_m: Array) -> Mask:
    """Return whether each marker (F, M) is in all simulated images."""
    pixels = [(camera.project(markers_m), camera.image_size) for camera in default_rig().cameras]
    return np.all([np.all((at >= 0.0) & (at < size), axis=-1) for at, size in pixels], axis=0)


def facing(motion: Motion, yaw_rad: float, place_m: Array) -> Motion:
    """Return the motion moved to `place_m` and rotated to face `yaw_rad` away from +z."""
    forward = rot.rotate(motion.rotations[0, 0], _FORWARD)
    turn = rot.from_rotation_vector(np.array([0.0, yaw_rad - np.arctan2(forward[0], forward[2]), 0.0]))
    rotations = motion.rotations.copy()
    rotations[:, 0] = rot.multiply(turn, rotations[:, 0])
    from_start = motion.root_positions_m - motion.root_positions_m[0] * _LEVEL
    return replace(motion, rotations=rotations, root_positions_m=rot.rotate(turn, from_start) + place_m)


def on_treadmill(motion: Motion) -> Motion:
    """Return the motion without its mean horizontal speed, as on a treadmill."""
    drift = motion.root_positions_m[-1] - motion.root_positions_m[0]
    drift[1] = 0.0
    passed = np.linspace(0.0, 1.0, motion.frames)[:, None]
    return replace(motion, root_positions_m=motion.root_positions_m - passed * drift)


def part_of(motion: Motion, frames: int, generator: np.random.Generator) -> Motion:
    """Return this many frames from a random position in a motion."""
    start = int(generator.integers(0, motion.frames - frames + 1))
    return sliced(motion, start, start + frames)


def frame_of(
    number: int, true: Array, generator: np.random.Generator, faults: Faults = USUAL
) -> tuple[MarkerFrame, Mask]:
    """Return a frame of points in random order, and the markers (M,) among them."""
    visible = np.isfinite(true[:, 0])
    shown = visible & (generator.random(len(true)) >= faults.lost)
    points = generator.permutation(true[shown] + generator.normal(0.0, faults.noise_m, (int(shown.sum()), 3)))
    if generator.random() < faults.ghost_frames:
        centre = true[visible].mean(axis=0) if visible.any() else np.array([0.0, 1.0, 0.0])
        ghosts = 1 if faults.ghosts == 1 else int(generator.integers(1, faults.ghosts + 1))
        points = np.vstack((points, centre + generator.normal(0.0, _GHOST_SPREAD_M, (ghosts, 3))))
    covariances = np.broadcast_to(faults.noise_m**2 * np.eye(3), (len(points), 3, 3))
    return MarkerFrame(number, number / FPS, points, covariances), shown


def play_cut(
    cut: Cut, database: Database, settings: SolveSettings, generator: np.random.Generator, faults: Faults = USUAL
) -> tuple[dict[str, Any], Mask, Array]:
    """Show a cut's markers without labels to a session, live and as a recorded take.

    Returns:
        Row of the table; (N,) frames of the second take with correct live labels, and their confidence.
    """
    body = Motion(cut.subject, FPS, cut.skeleton, t_pose(cut.skeleton)[None], np.zeros((1, 3)))
    session = MultiTargetSession([Session(true_subject(body), database, settings=settings)])
    given = [frame_of(number, true, generator, faults) for number, true in enumerate(cut.positions_m)]
    frames, shown = [frame for frame, _ in given], np.array([seen for _, seen in given])
    live = solve_frames(frames, session, cut.title, no_progress, causal=True).poses_of()
    session.reset()
    recorded = solve_frames(frames, session, cut.title, no_progress).poses_of()
    right = np.array(
        [_is_right(pose.observed_m, *seen) for pose, *seen in zip(live, cut.positions_m, shown, strict=True)]
    )
    after, confidence = right[cut.back :], np.array([pose.confidence for pose in live[cut.back :]])
    steady = [i for i in range(len(after) - _STEADY + 1) if after[i : i + _STEADY].all()]
    row: dict[str, Any] = {
        "cut": cut.title,
        "body": cut.subject,
        "hidden_s": round(cut.hidden / FPS, 3),
        "right_again_s": round((steady[0] if steady else AFTER) / FPS, 4),
        "never_right": int(not steady),
        "wrong_frames": int((~after).sum()),
        "doubted_wrong_frames": int((confidence[~after] < DOUBTFUL).sum()),
        "frames": len(after),
        "shown_markers": int(np.sum(shown)),
        "right_markers": _right_markers(live, cut, shown),
        "recorded_right_markers": _right_markers(recorded, cut, shown),
    }
    row["recorded_wrong_markers"] = row["shown_markers"] - row["recorded_right_markers"]
    return row, after, confidence


def _right_markers(poses: list[PerformerPose], cut: Cut, shown: Mask) -> int:
    """Return the share of the shown markers that have their own label, over all frames."""
    away = np.linalg.norm([pose.observed_m for pose in poses] - cut.positions_m, axis=2)
    return int(np.sum((away < _RIGHT_M) & shown))


def _is_right(located: Array, true: Array, shown: Mask) -> bool:
    """Return whether every located marker is at its true position, and at most one shown marker is not located."""
    named = np.isfinite(located[:, 0])
    if (named & ~np.isfinite(true[:, 0])).any() or int((shown & ~named).sum()) > 1:
        return False
    return bool(np.all(np.linalg.norm(located - true, axis=1)[named] < _RIGHT_M))


class Pair(NamedTuple):
    """Markers (F, M, 3) of two performers with the same body."""

    title: str
    motion: Motion
    markers_m: tuple[Array, Array]
    apart_m: float  # smallest distance between the centres of the bodies, or between the parts that meet


def crossings(takes: Mapping[str, Motion], count: int, generator: np.random.Generator) -> Iterator[Pair]:
    """Yield pairs of walking takes on one body that pass each other halfway through."""
    walks = {name: part for name, part in _middles(takes).items() if _gone_m(part) > _WALK_M}
    for first, second in _chosen(list(walks), count, generator):
        apart_m = float(generator.uniform(*_PASS_M))
        paths = []
        for placed, side in _opposite(walks[first], walks[second]):
            middle = placed.root_positions_m[_PAIR_FRAMES // 2] * _LEVEL
            paths.append(markers_of(placed) - middle - np.array([0.0, 0.0, side * 0.5 * apart_m]))
        yield Pair(f"{first} x {second}", walks[first], (paths[0], paths[1]), apart_m)


def meetings(takes: Mapping[str, Motion], count: int, generator: np.random.Generator) -> Iterator[Pair]:
    """Yield pairs of takes in place, on one body, that face each other and approach.

    For a second, right hands touch in every other pair, and torsos in the others.
    """
    stays = {
        name: part
        for name, part in _middles(takes).items()
        if np.ptp(part.root_positions_m[:, [0, 2]], axis=0).max() < _STAY_M
    }
    share = np.interp(np.arange(_PAIR_FRAMES), _MEETING, (0.0, 1.0, 1.0, 0.0))
    steps_m = _STEPS_M * (1.0 - share**2 * (3.0 - 2.0 * share))
    for number, (first, second) in enumerate(_chosen(list(stays), count, generator)):
        motion, near_m, hands = stays[first], float(generator.uniform(*_MEET_M)), number % 2 == 1
        met = [marker.name == "RHAN" if hands else marker.torso for marker in true_subject(motion).marker_set.markers]
        seen = []
        for placed, _ in _opposite(motion, stays[second]):
            shown = markers_of(placed)
            seen.append(shown - shown[_PAIR_FRAMES // 2, met].mean(axis=0) * (1.0 if hands else _LEVEL))
        seen[1] += np.array([1.0, 0.0, 0.0]) * (near_m + steps_m)[:, None, None]
        yield Pair(f"{first} + {second}, {'hands' if hands else 'torsos'}", motion, (seen[0], seen[1]), near_m)


def _chosen(names: list[str], count: int, generator: np.random.Generator) -> Iterator[tuple[str, str]]:
    for _ in range(count if len(names) > 1 else 0):
        first, second = generator.choice(names, 2, replace=False)
        yield str(first), str(second)


def _opposite(first: Motion, second: Motion) -> Iterator[tuple[Motion, float]]:
    """Yield both motions on the first one's body at the origin, one to the left and one to the right, with signs."""
    for motion, side in ((first, 1.0), (second, -1.0)):
        yield facing(replace(motion, skeleton=first.skeleton), side * 0.5 * np.pi, np.zeros(3)), side


def _middles(takes: Mapping[str, Motion]) -> dict[str, Motion]:
    starts = {name: (take.frames - _PAIR_FRAMES) // 2 for name, take in takes.items() if take.frames >= _PAIR_FRAMES}
    return {name: sliced(takes[name], start, start + _PAIR_FRAMES) for name, start in starts.items()}


def _gone_m(part: Motion) -> float:
    """Return how far a motion moves in the direction that it faces at first."""
    way = part.root_positions_m[-1] - part.root_positions_m[0]
    return float(np.dot(way, rot.rotate(part.rotations[0, 0], _FORWARD)))


def play_pair(
    pair: Pair, database: Database, settings: SolveSettings, generator: np.random.Generator
) -> dict[str, Any]:
    """Show both performers' markers without labels to a new session; return the row.

    Both have the same body, so the first frame that shows both determines who is who.
    """
    subject = true_subject(pair.motion)
    session = MultiTargetSession([Session(subject, database, settings=settings) for _ in range(2)])
    wrong, exchanged, turned = [], [], None
    for number, shown in enumerate(zip(*pair.markers_m, strict=True)):
        frame, _ = frame_of(number, np.concatenate(shown), generator, Faults(lost=0.0, ghost_frames=0.0))
        poses = session.step(frame).performers
        if turned is None and all(np.isfinite(pose.observed_m).any() for pose in poses):
            turned = _are_turned(poses, shown)
        shown = shown[::-1] if turned else shown
        away = [np.linalg.norm(pose.observed_m - true, axis=1) for pose, true in zip(poses, shown, strict=True)]
        apart = [
            np.linalg.norm(pose.observed_m[:, None] - other, axis=2)
            for pose, other in zip(poses, shown[::-1], strict=True)
        ]
        wrong.append(any(np.any(distances > _WRONG_M) for distances in away))
        exchanged.append(
            any(np.any((near < _WRONG_M) & (own > _WRONG_M)[:, None]) for near, own in zip(apart, away, strict=True))
        )
    longest_s = {
        name: round(max((stop - start for start, stop in runs(np.array(frames))), default=0) / FPS, 4)
        for name, frames in (("longest_wrong_s", wrong), ("longest_exchanged_s", exchanged))
    }
    row = {"crossing": pair.title, "apart_m": round(pair.apart_m, 3), "wrong_frames": int(np.sum(wrong))}
    return row | longest_s | {"frames": len(wrong)}


def _are_turned(poses: Sequence[PerformerPose], shown: Sequence[Array]) -> bool:
    """Return whether the first performer's markers are those shown second."""
    middles = [np.nanmean(pose.observed_m, axis=0) for pose in poses]
    straight, turned = (
        sum(np.linalg.norm(middle - markers.mean(axis=0)) for middle, markers in zip(middles, order, strict=True))
        for order in (shown, shown[::-1])
    )
    return bool(turned < straight)
