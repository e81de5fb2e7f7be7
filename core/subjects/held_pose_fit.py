"""Fit of a body and its marker offsets to the markers of held poses.

The body is a mixture of prototype bodies, as in section 4.2 of Chai and Hodgins 2005, with further differences between
bodies of the same size; the left and the right side have mixtures of their own. No one holds a pose or places a marker
exactly, so joint angles and offsets are unknowns too, each with a prior. The result is the likeliest body; the
curvature of the cost there shows how well the poses determine it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..body.skeleton import Skeleton, forward_kinematics
from ..body.standard_skeleton import mirrored_name
from ..geometry import rotations as rot
from ..geometry.arrays import Array
from ..geometry.least_squares import NormalEquations, levenberg_marquardt
from ..geometry.rigid_transform import kabsch
from ..markers.marker_set import MarkerSet

Pose = Callable[[Skeleton], Array]

_STEP_RAD = 1e-5  # step for derivatives with respect to joint angles


@dataclass(frozen=True)
class PoseFitSigmas:
    """Standard deviations of the markers and of the unknowns."""

    seen_m: float = 0.002  # position of a marker, due to measurement and skin motion
    offset_m: float = 0.010  # offset of a marker from its usual one
    unknown_offset_m: float = 0.030  # offset of a marker without a usual one from its joint
    least_direction_m: float = 1e-3  # standard deviation of a principal component below which it is left out
    side_share: float = 0.25  # coefficients of the mixture for one side alone, relative to those for both
    places_m: tuple[tuple[str, float], ...] = (("femur", 0.008), ("humerus", 0.014))  # position per axis
    lengths: tuple[tuple[str, float], ...] = (  # relative length of the bone that leads to the joint
        ("tibia", 0.04), ("foot", 0.04), ("radius", 0.05), ("wrist", 0.05), ("hand", 0.05),
    )  # fmt: skip
    own_share: float = 0.5  # factor of `places_m` and `lengths` for differences between the sides
    limbs_deg: tuple[tuple[str, float, str], ...] = (  # joint, deviation, axes of rotation
        ("humerus", 8.0, "xyz"), ("hand", 6.0, "yz"), ("femur", 6.0, "xyz"), ("foot", 4.0, "xyz"),
    )  # fmt: skip
    hinge_deg: float = 8.0  # elbows and knees
    trunk_deg: float = 8.0  # the whole back about each axis, relative to the first pose
    neck_deg: float = 10.0  # the whole neck, likewise
    collar_deg: float = 10.0  # clavicles, relative to the first pose


SIGMAS = PoseFitSigmas()


@dataclass(frozen=True)
class BodyFit:
    """The likeliest body and its poses.

    Args:
        rotations: Local rotations (N, J, 4) of each pose.
        root_positions_m: Root positions (N, 3).
        astray_rad: For each pose, the angle between the fitted and the calibration pose at the first joint of each
            limb, by joint name.
        sigmas_m: Standard deviation (J,) of each joint's distance from its parent; 0 for a known body.
    """

    skeleton: Skeleton
    rotations: Array
    root_positions_m: Array
    astray_rad: tuple[dict[str, float], ...]
    sigmas_m: Array


def fit_body(points_m: Array, marker_set: MarkerSet, prototypes: Sequence[Skeleton], poses: Sequence[Pose]) -> BodyFit:
    """Return the body that explains the points in the poses.

    Args:
        points_m: Markers (N, M, 3) of each pose in any world, NaN where hidden; at least three torso markers in each.
        marker_set: Markers with their joints, and their usual offsets if known.
        prototypes: Bodies of many sizes with the standard skeleton's joints; if there is only one, it is the known
            body.
        poses: Poses (N); the first one defines the upright trunk.
    """
    body = _BodyPrior(prototypes)
    held = [_HeldPose(pose, body.skeleton(), i == 0) for i, pose in enumerate(poses)]
    return _Fit(points_m, marker_set, body, held).solved()


class _BodyPrior:
    """Prior of bodies: a mean shape (J, 6) and directions (K, J, 6), whose coefficients have unit variance."""

    def __init__(self, prototypes: Sequence[Skeleton]) -> None:
        self.like = prototypes[0]
        shapes = np.array([np.concatenate((p.offsets_m, p.tips_m), axis=1) for p in prototypes])
        self.mean = shapes.mean(axis=0)
        self.directions = np.zeros((0, *self.mean.shape))
        if len(prototypes) > 1:
            mixed = self._mixed(shapes)
            names = self.like.names
            sides = np.array([name[0] if mirrored_name(name) != name else "m" for name in names])
            one_side = [np.where((sides == side)[:, None], SIGMAS.side_share * mixed, 0.0) for side in "lr"]
            self.directions = np.concatenate((mixed, *one_side, self._own()))

    def skeleton(self, coefficients: Array | float = 0.0) -> Skeleton:
        """Return the body with coefficients (K,); 0 gives the mean body."""
        weights = np.broadcast_to(coefficients, len(self.directions))
        shape = self.mean + np.tensordot(weights, self.directions, 1)
        like = self.like
        return Skeleton(like.names, like.parents, shape[:, :3], shape[:, 3:], like.angle_axes, like.angle_orders)

    def _mixed(self, shapes: Array) -> Array:
        """Return the principal components of the prototypes' shapes, scaled to unit variance."""
        count = len(shapes)
        _, spread, axes = np.linalg.svd((shapes - self.mean).reshape(count, -1), full_matrices=False)
        deviations = spread / np.sqrt(count - 1)
        kept = deviations > SIGMAS.least_direction_m
        return (deviations[kept, None] * axes[kept]).reshape(-1, *self.mean.shape)

    def _own(self) -> Array:
        """Return directions that change joint positions and bone lengths, on both sides alike and on each alone."""
        mirror = np.array([-1.0, 1.0, 1.0])
        changes = [
            (joint, sigma * axis, sigma * mirror * axis) for joint, sigma in SIGMAS.places_m for axis in np.eye(3)
        ]
        for joint, share in SIGMAS.lengths:
            left_m, right_m = (share * self.mean[self.like.index(side + joint), :3] for side in "lr")
            changes.append((joint, left_m, right_m))
        result = []
        for joint, left_m, right_m in changes:
            left, right = self._moved("l" + joint, left_m), self._moved("r" + joint, right_m)
            result += [left + right, SIGMAS.own_share * left, SIGMAS.own_share * right]
        return np.array(result)

    def _moved(self, name: str, change_m: Array) -> Array:
        """Return the change of shape (J, 6) that moves a joint and the end of the bone leading to it."""
        result, joint = np.zeros_like(self.mean), self.like.index(name)
        result[joint, :3] = change_m
        parent = int(self.like.parents[joint])
        if parent:  # the root's own bone ends in the back, not at the femurs
            result[parent, 3:] = change_m
        return result


class _HeldPose:
    """A calibration pose with the prior of a performer's deviations from its angles.

    The feet are flat on the floor even if the legs are bent, so their deviations are relative to the root.
    """

    def __init__(self, pose: Pose, skeleton: Skeleton, first: bool) -> None:
        self.asked = pose(skeleton)
        self.asked[0] = rot.identity()
        self.feet = [skeleton.index(side + "foot") for side in "lr"]
        world = forward_kinematics(skeleton, self.asked, np.zeros(3))[1]
        self.asked[self.feet] = world[self.feet]
        self.turns, self.sigmas_rad = self._angles(skeleton, first)

    def _angles(self, skeleton: Skeleton, first: bool) -> tuple[Array, Array]:
        """Return rotation vectors (A, J, 3) per unit of each angle, and the angles' standard deviations (A,)."""
        rows: list[tuple[tuple[str, ...], Array, float]] = []
        axes = dict(zip("xyz", np.eye(3), strict=True))
        for side in "lr":
            for joint, sigma, letters in SIGMAS.limbs_deg:
                rows += [((side + joint,), axes[letter], sigma) for letter in letters]
            leg = skeleton.tips_m[skeleton.index(f"{side}femur")] * [1.0, 1.0, 0.0]
            knee = np.cross(leg / np.linalg.norm(leg), [0.0, 0.0, 1.0])
            rows += [((f"{side}radius",), axes["y"], SIGMAS.hinge_deg), ((f"{side}tibia",), -knee, SIGMAS.hinge_deg)]
            if not first:
                rows += [((f"{side}clavicle",), axes[letter], SIGMAS.collar_deg) for letter in "yz"]
        if not first:
            back, neck = ("lowerback", "upperback", "thorax"), ("lowerneck", "upperneck", "head")
            for axis in np.eye(3) / 3.0:
                rows += [(back, axis, SIGMAS.trunk_deg), (neck, axis, SIGMAS.neck_deg)]
        turns = np.zeros((len(rows), len(skeleton), 3))
        for row, (joints, axis, _) in zip(turns, rows, strict=True):
            row[[skeleton.index(joint) for joint in joints]] = axis
        return turns, np.radians([sigma for _, _, sigma in rows])

    def local(self, angles_rad: Array, skeleton: Skeleton) -> Array:
        """Return the pose's local rotations (..., J, 4) with deviations (..., A) added."""
        turn = rot.from_rotation_vector(np.tensordot(angles_rad, self.turns, 1))
        result = rot.multiply(np.broadcast_to(self.asked, turn.shape), turn)
        for foot in self.feet:
            tibia = int(skeleton.parents[foot])
            above = rot.multiply(result[..., int(skeleton.parents[tibia]), :], result[..., tibia, :])
            result[..., foot, :] = rot.multiply(rot.conjugate(above), result[..., foot, :])
        return result

    def astray(self, angles_rad: Array, skeleton: Skeleton) -> dict[str, float]:
        """Return the angle of each limb's first joint from the pose, by joint name."""
        vectors = np.tensordot(angles_rad, self.turns, 1)
        joints = [side + joint for side in "lr" for joint in ("humerus", "femur")]
        return {joint: float(np.linalg.norm(vectors[skeleton.index(joint)])) for joint in joints}


@dataclass(frozen=True)
class _State:
    """Unknowns of the fit.

    Args:
        values: Coefficients of the body, offsets, and for each pose the deviations of its angles, a zero (3) in place
            of the root's rotation, and the root's position (3); all but the positions are in units of their standard
            deviations.
        matrices: World-from-root rotations (N, 3, 3).
    """

    values: Array
    matrices: Array


class _Fit:
    def __init__(self, points_m: Array, marker_set: MarkerSet, body: _BodyPrior, held: list[_HeldPose]) -> None:
        self.points, self.body, self.held = points_m, body, held
        self.joints = marker_set.joint_indices(body.like)
        self.torso = marker_set.torso
        self.usual = usual_offsets(marker_set)
        known = np.array([marker.offset_m is not None for marker in marker_set.markers])
        self.offset_sigmas = np.where(known, SIGMAS.offset_m, SIGMAS.unknown_offset_m)[:, None]
        # joints whose offsets add up to the position of each marker's joint
        self.carried = body.like.is_ancestor[self.joints].astype(np.float64)
        self.carried[:, 0] = 0.0
        ends = np.cumsum([len(body.directions), 3 * len(self.joints), *(len(pose.turns) + 6 for pose in held)]).tolist()
        self.bodies, self.shared, self.size = ends[0], ends[1], ends[-1]
        self.poses = [slice(*each) for each in pairwise(ends[1:])]
        self.bound = np.ones(self.size, dtype=np.bool_)  # unknowns with a prior
        for pose in self.poses:
            self.bound[pose.stop - 6 : pose.stop] = False

    def solved(self) -> BodyFit:
        """Return the fit; it starts from the mean body in the exact poses."""
        state, near = levenberg_marquardt(self._start(), self._linearise, self._moved)
        skeleton, _ = self._shape(state)
        rotations = []
        for i, held in enumerate(self.held):
            local = held.local(self._angles(state, i), skeleton)
            local[0] = rot.from_matrix(state.matrices[i])
            rotations.append(local)
        length = np.maximum(np.linalg.norm(skeleton.offsets_m, axis=1, keepdims=True), 1e-9)
        along = np.einsum("kjx,jx->jk", self.body.directions[:, :, :3], skeleton.offsets_m / length)
        shape = np.linalg.inv(near.matrix)[: self.bodies, : self.bodies]
        return BodyFit(
            skeleton,
            np.array(rotations),
            np.array([state.values[pose.stop - 3 : pose.stop] for pose in self.poses]),
            tuple(held.astray(self._angles(state, i), skeleton) for i, held in enumerate(self.held)),
            np.sqrt(np.einsum("jk,kl,jl->j", along, shape, along)),
        )

    def _start(self) -> _State:
        values, skeleton, matrices = np.zeros(self.size), self.body.skeleton(), []
        for held, points, pose in zip(self.held, self.points, self.poses, strict=True):
            seen = np.isfinite(points[:, 0])
            local = self._markers(held, np.zeros(len(held.turns)), skeleton, self.usual)[0]
            # limbs may be held differently, so their markers have a low weight, which only matters if the torso's are
            # almost on a line
            matrix, values[pose.stop - 3 : pose.stop] = kabsch(
                local[seen], points[seen], np.where(self.torso, 1.0, 0.05)[seen]
            )
            matrices.append(matrix)
        return _State(values, np.array(matrices))

    def _angles(self, state: _State, i: int) -> Array:
        return np.asarray(self.held[i].sigmas_rad * state.values[self.poses[i]][:-6])

    def _markers(self, held: _HeldPose, angles: Array, skeleton: Skeleton, offsets: Array) -> tuple[Array, Array]:
        """Return markers (..., M, 3) and joint orientations (..., J, 4) in the root's frame."""
        positions, world = forward_kinematics(skeleton, held.local(angles, skeleton), np.zeros(3))
        return positions[..., self.joints, :] + rot.rotate(world[..., self.joints, :], offsets), world

    def _shape(self, state: _State) -> tuple[Skeleton, Array]:
        offsets = state.values[self.bodies : self.shared].reshape(-1, 3)
        return self.body.skeleton(state.values[: self.bodies]), self.usual + self.offset_sigmas * offsets

    def _linearise(self, state: _State) -> NormalEquations:
        skeleton, offsets = self._shape(state)
        matrix, gradient = np.diag(self.bound.astype(np.float64)), np.where(self.bound, state.values, 0.0)
        cost = float(gradient @ gradient)
        for i, pose in enumerate(self.poses):
            columns, error = self._columns(state, i, skeleton, offsets)
            here = np.r_[: self.shared, pose]
            matrix[np.ix_(here, here)] += columns.T @ columns
            gradient[here] += columns.T @ error
            cost += float(error @ error)
        return NormalEquations(matrix, gradient, cost)

    def _columns(self, state: _State, i: int, skeleton: Skeleton, offsets: Array) -> tuple[Array, Array]:
        """Return Jacobian and residuals of the visible markers of a pose, in standard deviations.

        The Jacobian's columns are body, offsets, angles, and the root's rotation and position.
        """
        held, count, matrix = self.held[i], len(self.joints), state.matrices[i]
        angles = len(held.turns)
        tried = self._angles(state, i) + np.concatenate((np.zeros((1, angles)), _STEP_RAD * np.eye(angles)))
        markers, orientations = self._markers(held, tried, skeleton, offsets)
        local, world = markers[0], rot.to_matrix(orientations[0])
        above = world[np.maximum(skeleton.parents, 0)]
        by_body = np.einsum("mj,jxy,kjy->kmx", self.carried, above, self.body.directions[:, :, :3])
        by_offset = np.zeros((count, 3, count, 3))
        own = np.arange(count)
        by_offset[own, :, own] = self.offset_sigmas[:, :, None] * np.swapaxes(world[self.joints], 1, 2)
        by_angle = held.sigmas_rad[:, None, None] * (markers[1:] - local) / _STEP_RAD
        by_turn = np.cross(np.eye(3)[:, None], local)
        in_root = np.concatenate((by_body, by_offset.reshape(3 * count, count, 3), by_angle, by_turn))
        by_place = np.broadcast_to(np.eye(3)[:, None], (3, count, 3))
        columns = np.concatenate((in_root @ matrix.T, by_place))
        error = local @ matrix.T + state.values[self.poses[i]][-3:] - self.points[i]
        seen = np.isfinite(error[:, 0])
        return columns[:, seen].reshape(len(columns), -1).T / SIGMAS.seen_m, error[seen].ravel() / SIGMAS.seen_m

    def _moved(self, state: _State, step: Array) -> _State:
        values, matrices = state.values + step, []
        for matrix, pose in zip(state.matrices, self.poses, strict=True):
            turn = slice(pose.stop - 6, pose.stop - 3)
            matrices.append(matrix @ rot.to_matrix(rot.from_rotation_vector(step[turn])))
            values[turn] = 0.0
        return _State(values, np.array(matrices))


def usual_offsets(marker_set: MarkerSet) -> Array:
    """Return the usual offsets (M, 3); zero (at the joint) for markers without one."""
    return np.array([marker.offset_m or (0.0, 0.0, 0.0) for marker in marker_set.markers])
