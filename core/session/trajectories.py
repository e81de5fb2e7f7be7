"""A recorded stretch as solved in one direction of time, and the mean of several such solutions."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np

from ..body.body_parts import PART_JOINTS, PARTS
from ..body.scene_pose import PerformerPose
from ..body.window_filters import gaussian
from ..geometry import rotations as rot
from ..geometry.arrays import Array
from ..solver.following import Frame
from ..solver.motion_prior import PriorEstimate
from ..solver.observation import Observation
from ..solver.pose_solver import PoseSolver
from ..solver.solution import Solution
from .part_errors import PartErrors

_WEIGHT_POWER = 4.0  # power of the expected error by which a trajectory's weight is divided
_WEIGHT_S = 0.25  # standard deviation of the Gaussian window in which these errors are averaged
_UNKNOWN_DEG = 90.0  # error assumed for parts whose error is unknown
_TORSO = list(PARTS).index("torso")  # index of the part that contains the root
_FOLLOWED = 16  # number of frames that are given to the solver at once
TOGETHER = 128  # number of frames for which priors or fits are computed at once


@dataclass(frozen=True)
class Trajectory:
    """One solution of a stretch of F frames."""

    rotations: Array  # (F, J, 4)
    root_positions_m: Array  # (F, 3)
    errors_deg: Array  # (F, P) expected errors of parts
    joint_errors_deg: Array  # (F, J - 1) expected errors of joints

    def with_part(self, part: slice, other: "Trajectory") -> "Trajectory":
        """Return the solution with another one of some frames."""
        found = [getattr(self, each.name).copy() for each in fields(self)]
        for values, each in zip(found, fields(self), strict=True):
            values[part] = getattr(other, each.name)
        return Trajectory(*found)


def live_trajectory(poses: Sequence[PerformerPose]) -> Trajectory:
    """Return the live solution of a stretch."""
    return Trajectory(
        np.array([pose.rotations for pose in poses]),
        np.array([pose.root_position_m for pose in poses]),
        np.array([_known(pose.part_errors_deg, len(PARTS)) for pose in poses]),
        np.array([_known(pose.joint_errors_deg, len(pose.rotations) - 1) for pose in poses]),
    )


def solved_trajectory(
    solver: PoseSolver,
    poses: Sequence[PerformerPose],
    observations: Sequence[Observation],
    progress: Callable[[float], None],
    way: int,
) -> Trajectory:
    """Return a stretch solved in one direction of time.

    Where it cannot be solved, it has the live poses, forwards with their errors, backwards with infinite ones.

    Args:
        solver: Solver for that direction.
        poses: Live poses, which give the starting position and replace poses that are not solved.
        way: 1 for forwards, -1 for backwards.
    """
    live, part_errors = live_trajectory(poses), PartErrors(solver.subject)
    unsolved = (
        errors.copy() if way > 0 else np.full_like(errors, np.inf)
        for errors in (live.errors_deg, live.joint_errors_deg)
    )
    trajectory = Trajectory(live.rotations.copy(), live.root_positions_m.copy(), *unsolved)
    order, done = range(len(poses))[::way], 0
    state = replace(solver.initial_state, markers_m=poses[order[0]].markers_m)
    seen = [(observation, pose.markers_m) for observation, pose in zip(observations, poses, strict=True)]
    times_s = np.array([pose.time_s for pose in poses])
    learned: dict[int, PriorEstimate | None] = {}  # learned priors of the frames to come
    found: dict[int, Solution] = {}
    while done < len(order):
        progress(done / len(poses))
        index = order[done]
        if index not in learned:
            # priors are computed forwards in time, because the network was trained on forward motion
            first, stop = sorted((index, index + way * (TOGETHER - 1)))
            first, stop = max(first, 0), min(stop + 1, len(poses))
            earliest = int(np.searchsorted(times_s, times_s[first] - 2.0 * solver.best.longest_s))
            priors = solver.best.learned_priors(seen[earliest:stop], times_s[earliest:stop])[first - earliest :]
            learned = dict(zip(range(first, stop), priors, strict=True))
        coming = [each for each in order[done : done + _FOLLOWED] if each in learned]
        frames = [Frame(observations[each], way * float(times_s[each]), learned[each]) for each in coming]
        solutions, state = solver.follow(state, frames)
        done += len(solutions)
        found |= {each: solution for each, solution in zip(coming, solutions, strict=False) if solution is not None}
    for index, solution in found.items():
        trajectory.rotations[index] = solver.subject.rotations(solution.pose, solution.root)
        trajectory.root_positions_m[index] = solution.root.position_m
        joints_deg = part_errors.expected_joints_deg(solution)  # known, as only "best" solves in both directions
        trajectory.errors_deg[index] = part_errors.expected_deg(joints_deg)
        trajectory.joint_errors_deg[index] = joints_deg
    return trajectory


def _known(errors_deg: Array, count: int) -> Array:
    """Return expected errors (count,); large ones if they are unknown."""
    return errors_deg if len(errors_deg) else np.full(count, _UNKNOWN_DEG)


def blended(trajectories: Sequence[Trajectory], fps: float) -> Trajectory:
    """Return the mean of trajectories; the weight of each part depends on its expected error."""
    errors = np.array([trajectory.errors_deg for trajectory in trajectories])
    lasting = gaussian(np.minimum(errors, _UNKNOWN_DEG).swapaxes(0, 1), _WEIGHT_S * fps).swapaxes(0, 1)
    weights = np.where(np.isfinite(errors), lasting, np.inf) ** -_WEIGHT_POWER
    weights /= weights.sum(axis=0)
    first = trajectories[0].rotations
    rotations = np.zeros_like(first)
    root_m = np.zeros_like(trajectories[0].root_positions_m)
    joint_errors = np.zeros_like(trajectories[0].joint_errors_deg)
    for trajectory, weight in zip(trajectories, weights, strict=True):
        joints = np.empty(first.shape[:2])
        joints[:, 0] = weight[:, _TORSO]
        for part, part_joints in enumerate(PART_JOINTS.values()):
            joints[:, part_joints] = weight[:, part, None]
        side = np.where(np.sum(trajectory.rotations * first, axis=-1) < 0.0, -1.0, 1.0)
        rotations += (joints * side)[..., None] * trajectory.rotations
        root_m += weight[:, _TORSO, None] * trajectory.root_positions_m
        joint_errors += joints[:, 1:] * np.minimum(trajectory.joint_errors_deg, _UNKNOWN_DEG)
    part_errors = np.sum(weights * np.minimum(errors, _UNKNOWN_DEG), axis=0)
    return Trajectory(rot.normalize(rotations), root_m, part_errors, joint_errors)
