"""Following a tracked body over several frames at once, as far as nothing suggests that its motion was left."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..body.pose_notes import NoteKind
from ..geometry.arrays import Array, IntArray
from ..kernel.library import Packed, checked, function, stage
from .best_estimate import CONSTANTS, BestModel, best_estimate, work_for
from .gaussian_conditioning import Expectation, Prior
from .locator import Located, Locator
from .method import FrameProblem
from .motion_prior import PriorEstimate
from .observation import Observation
from .solution import Estimate, Solution, SolverState
from .subject_model import RootPose, SubjectModel

_JUMP_M = 0.07  # RMS movement of the markers between two frames above which history may mislead
_NUMBERS = 5  # values told about each frame: inflation, tilt, distance from the closest example, steps, examples
_CUT_M = 0.3  # RMS movement above which history is of another motion, because nobody moves all limbs so fast


class Frame(NamedTuple):
    """A frame to solve."""

    observation: Observation
    time_s: float
    learned: PriorEstimate | None  # learned prior, if there is a network


class Followed(NamedTuple):
    """Solutions of frames, the state after the last of them, and the one before it, with its time."""

    solutions: list[Solution]
    state: SolverState
    before: SolverState


@dataclass(frozen=True)
class Follower:
    """What follows a body with the method "best".

    Attributes:
        locator: Finds root and examples.
        model: Finds the pose.
        errors_last: The source's errors last, so its markers jump by more than history misleads.
    """

    locator: Locator
    model: BestModel
    errors_last: bool


def misleads(state: SolverState, observation: Observation, solution: Solution, errors_last: bool) -> NoteKind | None:
    """Return why history may mislead after a frame, or None if there is no sign that it does.

    Args:
        state: State before the frame.
    """
    if state.root is None or state.markers_m is None:
        return None
    seen = observation.located
    before_m = state.root.to_root_frame(state.markers_m[seen])
    jump_m = rms(solution.root.to_root_frame(observation.points_m[seen]) - before_m)
    if jump_m > _CUT_M:
        return NoteKind.CUT
    if errors_last:
        return None
    unexplained = rms(solution.markers_m[seen] - observation.points_m[seen]) > solution.nearest_m
    return NoteKind.NEARER_EXAMPLE if jump_m > _JUMP_M or unexplained else None


def rms(differences_m: Array) -> float:
    """Return the RMS length of differences (N, 3), 0 for none."""
    return float(np.sqrt(np.vdot(differences_m, differences_m) / max(len(differences_m), 1)))


def solved(
    subject: SubjectModel, state: SolverState, located: Located, estimate: Estimate
) -> tuple[Solution, SolverState]:
    """Return the solution of a frame, and the state after it, from the one before it."""
    pose = estimate.pose.reshape(-1, 3)
    markers_m = subject.markers(pose, estimate.root)
    numbers = estimate.neighbours, estimate.dimensions, located.nearest_m, estimate.iterations
    doubts = estimate.uncertainty_rad, estimate.tilt_rad, estimate.prior_led
    solution = Solution(pose, estimate.root, markers_m, *numbers, *doubts)
    after = replace(
        state,
        root=estimate.root,
        markers_m=markers_m,
        pose=estimate.pose,
        previous_pose=state.pose,
        found=located.found,
        expectation=estimate.expectation,
    )
    return solution, after


def remembering(state: SolverState, observation: Observation, solution: Solution | None) -> SolverState:
    """Return a state with the markers of its frame, which are in space, and its pose in the histories."""
    observed = state.observed.remember(state.time_s, observation.points_m)
    if solution is None:
        return replace(state, observed=observed)
    return replace(state, observed=observed, solved=state.solved.remember(state.time_s, solution.pose.ravel()))


_FOLLOW = function("follow", "pppp")


class _Found(NamedTuple):
    """What the kernel finds for F frames, with the last frame before them or all that history holds."""

    counts: IntArray  # (4,) frames found by the last search, examples, frames visited, frames solved
    solved: Array  # (E + F, D) poses
    roots: Array  # (1 + F, 7)
    markers_m: Array  # (1 + F, M, 3)
    uncertainties: Array  # (F, J - 1)
    numbers: Array  # (F, 5)
    prior_mean: Array  # (D,) of the last frame, with covariance (D, D) and root (9,)
    prior_covariance: Array
    prior_root: Array


def _room(state: SolverState, root: RootPose, markers_m: Array, count: int, size: int) -> _Found:
    """Return room for so many frames and poses of this size, after a state with this root and these markers."""
    earlier = len(state.solved.values)
    solved, roots = np.empty((earlier + count, size)), np.empty((1 + count, 7))
    bodies_m = np.empty((1 + count, *markers_m.shape))
    if earlier:
        solved[:earlier] = state.solved.values
    roots[0, :4], roots[0, 4:], bodies_m[0] = root.rotation, root.position_m, markers_m
    of_frames = np.empty((count, size // 3)), np.empty((count, _NUMBERS))
    prior = np.empty(size), np.empty((size, size)), np.empty(9)
    return _Found(np.zeros(4, dtype=np.int64), solved, roots, bodies_m, *of_frames, *prior)


def _compiled(follower: Follower, state: SolverState, frames: Sequence[Frame], checks_from: int) -> Followed:
    locator = follower.locator
    if locator.packed is None or state.root is None or state.pose is None or state.markers_m is None:
        return follow.numpy_body(follower, state, frames, checks_from)
    observed_m, places = _histories(follower.model, state, frames)
    controls = [frame.observation.controls for frame in frames]
    starts = np.cumsum([0, *(len(each.markers) for each in controls)])
    rows = [np.ascontiguousarray(np.concatenate(each)) for each in zip(*controls, strict=True)]
    hidden = np.array([follower.model.subject.hidden_joints(frame.observation.seen) for frame in frames])
    points_m = np.array([frame.observation.points_m for frame in frames])
    work, examples = _memory(follower, len(state.pose), int(np.diff(starts).max()))
    found = _room(state, state.root, state.markers_m, len(frames), len(state.pose))
    stretch = Packed(
        len(frames), len(state.solved.values), checks_from, points_m, observed_m, places, starts, *rows,
        *_learned(frames), hidden, state.pose, state.previous_pose, follower.errors_last, _CUT_M, _JUMP_M,
        *work, *examples, *found,
    )  # fmt: skip
    checked(_FOLLOW(locator.packed.address, follower.model.packed.address, CONSTANTS.address, stretch.address))
    locator.search.visited += int(found.counts[2])
    return _followed(follower.model, state, frames, found, examples[0][: found.counts[0]])


def _histories(model: BestModel, state: SolverState, frames: Sequence[Frame]) -> tuple[Array, IntArray]:
    """Return what F frames have of the past.

    Returns:
        The earlier markers (F, L, M, 3), and the places (F, L) of earlier poses among all that will be known by then,
        -1 where unknown.
    """
    observed_m, places = [], []
    observed, lags_s, earlier = state.observed, model.earlier_markers.lags_s, len(state.solved.values)
    place = replace(state.solved, values=tuple(np.arange(earlier)[:, None]))
    for number, frame in enumerate(frames, earlier):
        observed_m.append(model.earlier_markers.recent(observed, frame.time_s))
        places.append(place.recent(frame.time_s, lags_s, (1,))[:, 0])
        observed = observed.remember(frame.time_s, frame.observation.points_m)
        place = place.remember(frame.time_s, np.array([number]))
    return np.array(observed_m), np.nan_to_num(places, nan=-1.0).astype(np.int64)


def _learned(frames: Sequence[Frame]) -> Sequence[Array | None]:
    """Return means, covariances, roots and their deviations of the learned priors of frames, if there are any."""
    known = [frame.learned for frame in frames if frame.learned]
    if not known:
        return [None] * 4
    roots = [np.concatenate((each.root.rotation, each.root.position_m)) for each in known]
    columns = zip(*((*each.pose, root, each.root_sigma) for each, root in zip(known, roots, strict=True)), strict=True)
    return [np.array(column) for column in columns]


def _memory(follower: Follower, size: int, rows: int) -> tuple[list[NDArray[Any]], list[NDArray[Any]]]:
    """Return the kernel's work, and what it needs for the frames and examples found for a frame with so many rows."""
    locator, model = follower.locator, follower.model
    wanted, markers = locator.examples, len(model.subject.joints)
    *of_locating, among, found = locator.memory()
    pairs = zip(of_locating, work_for(model, wanted, rows, size), strict=True)
    doubles, singles = (max(map(len, pair)) for pair in pairs)
    own = size * (1 + len(model.earlier_markers.lags_s)) + 6 * markers
    work: list[NDArray[Any]] = [np.empty(own + doubles), np.empty(singles, dtype=np.float32), among]
    examples = np.empty(wanted, dtype=np.int64), np.empty(wanted), np.empty((wanted, size), dtype=np.float32)
    return work, [found, *examples, np.empty((wanted, markers, 3), dtype=np.float32)]


def _followed(
    model: BestModel, state: SolverState, frames: Sequence[Frame], found: _Found, last_found: IntArray
) -> Followed:
    """Return the solutions of all frames that were solved, and the states."""
    done, first = int(found.counts[3]), len(found.solved) - len(frames)
    solutions: list[Solution] = []
    before = after = state
    for number, frame in enumerate(frames[:done]):
        before = replace(after, time_s=frame.time_s, learned=frame.learned)
        pose, place, markers_m = found.solved[first + number], found.roots[number + 1], found.markers_m[number + 1]
        inflation, tilt_rad, nearest_m, steps, examples = found.numbers[number].tolist()
        root = RootPose(place[:4], place[4:])
        doubts = found.uncertainties[number], tilt_rad, inflation > 1.0
        solution = Solution(pose.reshape(-1, 3), root, markers_m, int(examples), 0, nearest_m, int(steps), *doubts)
        solutions.append(solution)
        after = replace(before, root=root, markers_m=markers_m, pose=pose, previous_pose=before.pose, found=last_found)
        if number < done - 1:
            after = remembering(after, frame.observation, solution)
    place = found.prior_root
    root, sigma = RootPose(place[:4], place[4:7]), (float(place[7]), float(place[8]))
    prior = Prior(found.prior_mean, found.prior_covariance)
    expectation = Expectation(prior, frames[done - 1].observation, root, sigma, model.limits)
    return Followed(solutions, replace(after, expectation=expectation), before)


@stage(_compiled)
def follow(follower: Follower, state: SolverState, frames: Sequence[Frame], checks_from: int) -> Followed:
    """Solve frames that continue a motion, until the last, or until one after which history may mislead.

    Args:
        state: State before the frames, with a pose.
        frames: All have a learned prior, or none has, and so many torso markers are located that they show the root.
        checks_from: Number of the first frame after which history may mislead.
    """
    solutions: list[Solution] = []
    before = after = state
    for number, frame in enumerate(frames):
        before = replace(after, time_s=frame.time_s, learned=frame.learned)
        located = follower.locator.alternate(before, frame.observation)
        if located is None:
            raise ValueError("the torso of a body that is followed must be seen")
        problem = FrameProblem(before, frame.observation, located.root, located.examples)
        solution, after = solved(
            follower.model.subject, before, located, best_estimate(follower.model, problem, frame.learned)
        )
        solutions.append(solution)
        if number == len(frames) - 1 or (
            number >= checks_from and misleads(before, frame.observation, solution, follower.errors_last)
        ):
            break
        after = remembering(after, frame.observation, solution)
    return Followed(solutions, after, before)
