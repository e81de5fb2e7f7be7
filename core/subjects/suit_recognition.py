"""Recognition of the marker set, and of each trajectory's marker, in a take whose labels say nothing.

1. Frames are superimposed with robust weights, so that the trunk is at rest. The medians of the trajectories are the
   take's mean shape.
2. For each known marker set, bodies that wear it in typical poses are placed in this shape, along every axis and
   heading.
3. Starting from the best placements, the database's nearest examples of each frame and one assignment for all frames
   are found alternately.
4. The solver poses the body with the assigned markers, bones and offsets are fitted, and the markers are assigned
   again. Feet, hands and head take part last: a foot with its markers assigned the wrong way round would turn to fit
   them.

Distances alone cannot tell left from right. A mirrored assignment turns the body round, so that its knees and feet
point backwards. This is solved as well, and must explain the trajectories clearly worse.
"""

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..body.calibration_poses import standing, t_pose
from ..body.standard_skeleton import default_skeleton, scaled
from ..database.store import Database
from ..errors import TakeError
from ..geometry.arrays import Array, IntArray, evenly, mean_of_known, median_of_known
from ..geometry.gated_assignment import assign
from ..geometry.rigid_transform import kabsch
from ..labelling.template_labelling import Similarity, similarity
from ..labelling.up_axis import TURNS
from ..markers.marker_set import FEWEST_TORSO, MarkerSet, PointKind, load_marker_set, marker_set_names
from ..markers.marker_take import MarkerTake
from ..markers.source_noise import noise_of
from ..markers.subject import Subject
from ..session.body_examples import BodyExamples
from ..solver.marker_selection import worn_in
from ..solver.subject_model import SubjectModel
from ..system.progress import Progress, no_progress
from .from_motion import body_of_poses
from .unknown_marker_placement import solved_poses


@dataclass(frozen=True)
class RecognitionSettings:
    """Settings of the recognition, chosen on simulated and recorded takes; costs are sums of squared distances."""

    fewest: int = 8  # fewest trajectories among which a body is recognised
    frames: int = 40  # number of frames, spread over the take, from which the mean shape is made
    compared: int = 12  # number of these frames in which bodies are compared
    shape_rounds: int = 8  # rounds in which frames are superimposed
    rest_m: float = 0.03  # spread of a trunk marker once frames are aligned on the trunk; it limits the weights
    radius_m: tuple[float, float] = (0.2, 1.2)  # range of the RMS radius of a mean shape; outside it, the unit is wrong
    usual_radius_m: float = 0.5  # RMS radius to which a shape in the wrong unit is scaled
    sizes: tuple[float, float] = (0.5, 5.0)  # range of a set's number of markers, relative to that of trajectories
    poses: int = 16  # number of typical poses from the database
    headings: int = 16
    refined: int = 80  # number of placements of a body in the mean shape that are refined
    refinements: int = 10
    scales: tuple[float, float] = (0.75, 1.3)  # size of bodies relative to the default skeleton
    starts: int = 4  # largest number of placements pursued for each set
    same: float = 0.7  # fraction of equal assignments above which two starts are the same
    examples: int = 700  # number of database poses compared with each frame
    nearest: int = 6  # number of nearest examples from which the positions of markers are predicted
    rounds: int = 6  # number of times that examples and assignment are found alternately
    placed_m: float = 0.3  # largest distance of a trajectory from a marker of the mean shape
    example_m: float = 0.22  # the same for the nearest examples
    free_m: float = 0.2  # the same for a body solved without markers on feet, hands and head
    solved_m: float = 0.15  # the same for a solved body
    capped_m: float = 0.25  # cap on each distance
    missed_m: float = 0.1  # distance assumed for a marker without a trajectory
    ends_free: int = 3  # number of rounds in which the solver uses no markers on feet, hands and head
    most_ends: float = 0.4  # fraction of all markers on feet, hands and head above which they always take part
    all_solved: int = 3  # number of rounds in which the solver uses all markers
    solved: int = 3  # number of best assignments that are solved, in addition to a mirrored one
    turned_rad: float = 2.0  # angle between the headings of two assignments above which they mirror each other
    clearer: float = 1.25  # factor by which the cost of the mirrored assignment must be higher
    recognised: float = 0.6  # smallest recognised fraction of the set or of the trajectories, whichever are fewer
    clear_m: float = 0.055  # RMS distance of all markers from those expected below which the names are clear
    residual_m: float = 0.03  # largest median distance of the recognised markers from the body


_S = RecognitionSettings()
_NO_SUIT = "their motion fits no known marker set"
_ENDS = ("foot", "toes", "hand", "fingers", "thumb", "head", "upperneck")


class _Suit(NamedTuple):
    """Marker set, with its markers (K, M, 3) on the default skeleton in typical poses."""

    marker_set: MarkerSet
    usual_m: Array


class _Placement(NamedTuple):
    """Body placed in the mean shape: p_body = scale (turn p_shape) + shift."""

    cost: float
    labels: IntArray  # (N,) marker of each trajectory, -1 if it has none
    fit: Similarity


class _Guess(NamedTuple):
    """Assignment of trajectories to a set's markers in the compared frames."""

    cost: float
    labels: IntArray  # (N,)
    marker_set: MarkerSet
    size: float  # size of the skeleton relative to the default one
    turns: Array  # (F, 3, 3) root-from-world rotations
    residual_m: float = np.nan


class RecognisedSuit(NamedTuple):
    """A recognised marker set.

    Args:
        names: Name of the marker for each recognised label.
        is_clear: The expected body explains the markers so well that no other names are possible, and all markers of
            the set or all trajectories are named.
    """

    marker_set: MarkerSet
    names: dict[str, str]
    is_clear: bool


def recognise_suit(take: MarkerTake, database: Database, why: str, progress: Progress = no_progress) -> RecognisedSuit:
    """Return the shipped marker set that fits a take's trajectories best, with the names of its markers.

    Args:
        take: Take under any labels, in any axes.
        database: Database with motion like the take's.
        why: What is wrong with the take's labels, for messages.

    Raises:
        TakeError: The trajectories fit no marker set, or do not tell left from right.
    """
    shown = np.flatnonzero(take.visible.any(axis=0))
    if len(shown) < _S.fewest or take.single is not None:
        raise _refusal(take, why, f"there are too few trajectories ({len(shown)}) to show a body")
    points_m, turns, shifts_m, shape_m = _laid_over(take.positions_m[:, shown])
    compared = evenly(len(points_m), _S.compared)
    points_m, turns, shifts_m = points_m[compared], turns[compared], shifts_m[compared]
    guesses: list[_Guess] = []
    suits = _suits(len(shown), database)
    for number, suit in enumerate(suits):
        progress(0.7 * number / len(suits), "recognising the markers")
        for start in _starts(shape_m, suit):
            guesses.append(_compare(points_m, turns, shifts_m, start.fit, suit.marker_set, database))
    solved = []
    for number, guess in enumerate(_worth_solving(guesses)):
        progress(0.7 + 0.3 * number / _S.solved, "recognising the markers")
        with contextlib.suppress(TakeError):  # too few torso markers
            solved.append(_solve(points_m, guess, database))
    if not solved:
        raise _refusal(take, why, _NO_SUIT)
    return _decided(take, why, solved, [take.names[i] for i in shown])


def _refusal(take: MarkerTake, why: str, what: str) -> TakeError:
    advice = "choose the marker set that was worn, or give a file that says which label is which marker"
    return TakeError(f"{why}, and {what}", where=take.name, advice=advice)


def _laid_over(positions_m: Array) -> tuple[Array, Array, Array, Array]:
    """Return frames (F, N, 3) of a take, turns (F, 3, 3) and shifts (F, 3) to its mean shape, and that shape (N, 3).

    Markers that move little relative to most others have the largest weights, so that the trunk is at rest.
    """
    count = np.isfinite(positions_m[..., 0]).sum(axis=1)
    telling = np.flatnonzero(count >= max(FEWEST_TORSO, 0.5 * count.max()))
    points_m = positions_m[telling[evenly(len(telling), _S.frames)]]
    seen = np.isfinite(points_m[..., 0])
    shape_m, weights = points_m[seen.sum(axis=1).argmax()], np.ones(points_m.shape[1])
    turns, shifts_m = np.tile(np.eye(3), (len(points_m), 1, 1)), np.zeros((len(points_m), 3))
    for _ in range(_S.shape_rounds):
        for f, row in enumerate(points_m):
            common = seen[f] & np.isfinite(shape_m[:, 0])
            if common.sum() >= FEWEST_TORSO:
                turns[f], shifts_m[f] = kabsch(row[common], shape_m[common], weights[common])
        moved_m = np.einsum("fij,fnj->fni", turns, points_m) + shifts_m[:, None]
        shape_m = median_of_known(moved_m)
        spread_m = np.nan_to_num(median_of_known(np.linalg.norm(moved_m - shape_m, axis=-1)), nan=np.inf)
        weights = 1.0 / (_S.rest_m**2 + spread_m**2)
    radius_m = float(np.sqrt(np.nanmean(np.sum((shape_m - np.nanmedian(shape_m, axis=0)) ** 2, axis=-1))))
    if not _S.radius_m[0] < radius_m < _S.radius_m[1]:  # the unit is wrong, which is reported later
        points_m, shifts_m, shape_m = (
            values * _S.usual_radius_m / radius_m for values in (points_m, shifts_m, shape_m)
        )
    return points_m, turns, shifts_m, shape_m


def _suits(trajectories: int, database: Database) -> list[_Suit]:
    """Return the marker sets, in typical poses, that a take with this number of trajectories may show."""
    skeleton, found = default_skeleton(), []
    for name in marker_set_names():
        worn = load_marker_set(name)
        if worn.points is PointKind.KEYPOINTS or not _S.sizes[0] <= len(worn) / trajectories <= _S.sizes[1]:
            continue
        model = SubjectModel(Subject(name, skeleton, worn), database.reference_pose_of(skeleton, name))
        poses_m = [worn.positions_on(skeleton, pose(skeleton)) for pose in (standing, t_pose)]
        usual_m = model.database_markers(database, evenly(database.frames, _S.poses))
        found.append(_Suit(worn, np.concatenate((poses_m, usual_m)).astype(np.float64)))
    return found


def _starts(shape_m: Array, suit: _Suit) -> list[_Placement]:
    """Return the best placements of a marker set in the mean shape (N, 3) that differ from each other."""
    seen = np.isfinite(shape_m[:, 0])
    rough = sorted(
        (each for usual_m in suit.usual_m for each in _rough_placements(shape_m[seen], usual_m)),
        key=lambda each: each[0],
    )
    found: list[_Placement] = []
    refined = [_refined(shape_m, usual_m, fit) for _, usual_m, fit in rough[: _S.refined]]
    for placed in sorted(refined, key=lambda each: each.cost):
        common = [np.mean(placed.labels == other.labels) for other in found]
        if len(found) < _S.starts and max(common, default=0.0) < _S.same:
            found.append(placed)
    return found


def _rough_placements(shape_m: Array, usual_m: Array) -> list[tuple[float, Array, Similarity]]:
    """Return placements of a body with markers (M, 3) in the shape, along all axes and headings, with their costs.

    Each aligns either the median, the lowest or the highest markers, because markers may be worn on the legs alone.
    """
    found = []
    angles = 2.0 * np.pi * np.arange(_S.headings) / _S.headings
    headings = np.zeros((_S.headings, 3, 3))
    headings[:, 0, 0] = headings[:, 2, 2] = np.cos(angles)
    headings[:, 0, 2], headings[:, 1, 1], headings[:, 2, 0] = np.sin(angles), 1.0, -np.sin(angles)
    for axis in TURNS.values():  # more placements at once would exceed the CPU cache
        turns = headings @ axis
        turned_m = shape_m @ turns.transpose(0, 2, 1)
        middles_m = np.median(usual_m, axis=0) - np.median(turned_m, axis=1)
        shifts_m = np.repeat(middles_m[:, None], 3, axis=1)  # (headings, heights, 3)
        shifts_m[:, 1, 1] = usual_m[:, 1].min() - turned_m[..., 1].min(axis=1)
        shifts_m[:, 2, 1] = usual_m[:, 1].max() - turned_m[..., 1].max(axis=1)
        apart2 = _squares(turned_m[:, None] + shifts_m[:, :, None], usual_m)
        costs = np.minimum(apart2.min(axis=-1), _S.placed_m**2).sum(axis=-1)
        costs += 0.5 * np.minimum(apart2.min(axis=-2), _S.capped_m**2).sum(axis=-1)
        for heading, turn in enumerate(turns):
            for cost, shift_m in zip(costs[heading].tolist(), shifts_m[heading], strict=True):
                found.append((cost, usual_m, Similarity(turn, shift_m, 1.0)))
    return found


def _squares(points_m: Array, others_m: Array) -> Array:
    """Return squared distances (..., N, M)."""
    apart_m = points_m[..., :, None, :] - others_m[..., None, :, :]
    return np.asarray(np.einsum("...c,...c->...", apart_m, apart_m))


def _refined(shape_m: Array, usual_m: Array, fit: Similarity) -> _Placement:
    """Return the placement refined by alternately assigning markers and fitting the shape to them."""
    labels = np.full(len(shape_m), -1)
    cost = np.inf
    for _ in range(_S.refinements):
        before = labels
        cost, labels = _assigned(_squares(fit.apply(shape_m), usual_m), _S.placed_m)
        known = labels >= 0
        if known.sum() <= FEWEST_TORSO or np.array_equal(labels, before):
            break
        fit = similarity(shape_m[known], usual_m[labels[known]], _S.scales)
    return _Placement(cost, labels, fit)


def _assigned(squares: Array, gate_m: float) -> tuple[float, IntArray]:
    """Return cost and labels (N,) of the best assignment for squared distances (N, M), NaN where unknown."""
    squares = np.where(np.isfinite(squares), squares, np.inf)
    rows, columns = assign(squares / gate_m**2)
    labels = np.full(len(squares), -1)
    labels[rows] = columns
    missed = squares.shape[1] - len(rows)
    cost = squares[rows, columns].sum() + gate_m**2 * (len(squares) - len(rows)) + _S.missed_m**2 * missed
    return float(cost), labels


def _compare(
    points_m: Array, turns: Array, shifts_m: Array, fit: Similarity, marker_set: MarkerSet, database: Database
) -> _Guess:
    """Return one assignment for all frames (F, N, 3), found in alternation with the examples nearest to each frame."""
    size = 1.0 / fit.scale
    skeleton = scaled(default_skeleton(), size)
    model = SubjectModel(Subject("", skeleton, marker_set), database.reference_pose_of(skeleton, ""))
    usual_m = BodyExamples(model, database).markers_m
    examples_m = usual_m[evenly(len(usual_m), _S.examples)].astype(np.float64)
    turns, shifts_m = fit.turn @ turns, shifts_m @ fit.turn.T + size * fit.shift
    labels = np.full(points_m.shape[1], -1)
    cost = np.inf
    for _ in range(_S.rounds):
        apart2, before = np.full((*points_m.shape[:2], len(marker_set)), np.nan), labels
        for f, row in enumerate(points_m):
            seen = np.flatnonzero(np.isfinite(row[:, 0]))
            nearest_m = _nearest_examples(row[seen] @ turns[f].T + shifts_m[f], before[seen], examples_m)
            own = seen[before[seen] >= 0]
            if len(own) >= FEWEST_TORSO:
                target_m = nearest_m[0, before[own]]
                off2 = np.sum((row[own] @ turns[f].T + shifts_m[f] - target_m) ** 2, axis=1)
                turns[f], shifts_m[f] = kabsch(row[own], target_m, 1.0 / (_S.rest_m**2 + off2))
            moved_m = row[seen] @ turns[f].T + shifts_m[f]
            apart2[f, seen] = np.minimum(_squares(moved_m, nearest_m), _S.capped_m**2).mean(axis=0)
        cost, labels = _assigned(mean_of_known(apart2), _S.example_m)
        if np.array_equal(labels, before):
            break
    return _Guess(cost, labels, marker_set, size, turns)


def _nearest_examples(points_m: Array, labels: IntArray, examples_m: Array) -> Array:
    """Return the examples (K, M, 3) nearest to points (N, 3), whose labels (N,) may all still be -1."""
    known = labels >= 0
    if known.any():
        apart2 = np.sum((points_m[known] - examples_m[:, labels[known]]) ** 2, axis=-1)
        cost = np.minimum(apart2, _S.capped_m**2).sum(axis=1)
    else:
        norms = np.einsum("emc,emc->em", examples_m, examples_m)
        apart2 = np.sum(points_m**2, axis=1)[:, None] + norms[:, None] - 2.0 * (points_m @ examples_m.swapaxes(1, 2))
        cost = np.minimum(apart2.min(axis=2), _S.capped_m**2).sum(axis=1)
        cost += 0.5 * np.minimum(apart2.min(axis=1), _S.capped_m**2).sum(axis=1)
    return np.asarray(examples_m[np.argsort(cost)[: _S.nearest]])


def _worth_solving(guesses: Sequence[_Guess]) -> list[_Guess]:
    """Return the best guesses, including the best of those whose body faces the opposite way to the very best one."""
    ordered: list[_Guess] = []
    for guess in sorted(guesses, key=lambda guess: guess.cost):
        if not any(
            other.marker_set is guess.marker_set and np.array_equal(other.labels, guess.labels) for other in ordered
        ):
            ordered.append(guess)
    chosen = ordered[: _S.solved]
    return [*chosen, *[guess for guess in ordered[_S.solved :] if _is_turned(guess, ordered[0])][:1]]


def _is_turned(guess: _Guess, other: _Guess) -> bool:
    """Return whether the bodies of two guesses face opposite ways in most frames."""
    traces = np.einsum("fij,fij->f", guess.turns, other.turns)
    angles = np.arccos(np.clip(0.5 * (traces - 1.0), -1.0, 1.0))
    return bool(np.median(angles) > _S.turned_rad)


def _solve(points_m: Array, guess: _Guess, database: Database) -> _Guess:
    """Return the guess refined by alternately solving the frames, fitting the body and assigning the markers."""
    worn, labels = guess.marker_set, guess.labels
    vertical = guess.turns[:, 1].mean(axis=0)
    upright = max(TURNS.values(), key=lambda turn: float(turn[1] @ vertical))
    part = MarkerTake("", 1.0, tuple(f"{i}" for i in range(len(labels))), points_m @ upright.T)
    start = subject = Subject("", scaled(default_skeleton(), guess.size), worn)
    is_end = np.array([marker.joint in _ENDS or marker.joint[1:] in _ENDS for marker in worn.markers])
    if np.mean(is_end) > _S.most_ends:
        is_end[:] = False
    cost, residual_m = np.inf, np.inf
    for ends_free in (*[True] * _S.ends_free, *[False] * _S.all_solved):
        used = np.where(is_end[labels], -1, labels) if ends_free else labels
        rotations, root_m = _poses(part, used, subject, database)
        solved_m = subject.marker_set.positions_on(subject.skeleton, rotations, root_m)
        apart2 = np.minimum(_squares(part.positions_m, solved_m), _S.capped_m**2)
        cost, labels = _assigned(mean_of_known(apart2), _S.free_m if ends_free else _S.solved_m)
        cost += float(np.sum((subject.marker_set.offsets_m - worn.offsets_m) ** 2))
        known = np.flatnonzero(labels >= 0)
        if not len(known):  # the body is far from all points
            return guess._replace(cost=cost, labels=labels)
        residual_m = float(np.sqrt(np.nanmedian(apart2[:, known, labels[known]])))
        observed = np.full((len(points_m), len(worn), 3), np.nan)
        observed[:, labels[known]] = part.positions_m[:, known]
        observed[:, is_end & ends_free] = np.nan
        subject = body_of_poses(rotations, observed, start, noise_of(worn.points))
    return guess._replace(cost=cost, labels=labels, residual_m=residual_m)


def _poses(part: MarkerTake, labels: IntArray, subject: Subject, database: Database) -> tuple[Array, Array]:
    """Return rotations (F, J, 4) and root positions (F, 3), solved from trajectories with labels (N,)."""
    names = subject.marker_set.names
    named = replace(part, names=tuple(names[k] if k >= 0 else f"{i}" for i, k in enumerate(labels)))
    return solved_poses(named, worn_in(named, subject), database)


def _decided(take: MarkerTake, why: str, solved: list[_Guess], shown: list[str]) -> RecognisedSuit:
    """Return the best solved guess; raise TakeError if it does not fit, or if its mirror image fits as well."""
    best = min(solved, key=lambda guess: guess.cost)
    known = int(np.sum(best.labels >= 0))
    if known < _S.recognised * min(len(best.marker_set), len(shown)) or not best.residual_m < _S.residual_m:
        raise _refusal(take, why, _NO_SUIT)
    if any(_is_turned(guess, best) and guess.cost < _S.clearer * best.cost for guess in solved):
        raise _refusal(take, why, "their motion does not tell left from right")
    names = best.marker_set.names
    of_labels = {label: names[k] for label, k in zip(shown, best.labels.tolist(), strict=True) if k >= 0}
    is_clear = best.cost < _S.clear_m**2 * known and known == min(len(best.marker_set), len(shown))
    return RecognisedSuit(best.marker_set, of_labels, is_clear)
