"""Fit of a body and its marker offsets to the markers of held poses.

The body is a mixture of prototype bodies, as in section 4.2 of Chai and Hodgins 2005, with what bodies of one size
differ in besides; the left and the right side have mixtures of their own. Nobody holds a pose exactly or places a
marker exactly, so joint angles and offsets are unknown too, each within its usual range: the fit is the most probable
body (Gauss-Newton on all unknowns at once), and the curvature there shows how well these poses determine it.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..body.skeleton import Skeleton, forward_kinematics
from ..body.standard_skeleton import mirrored_name
from ..geometry import rotations as rot
from ..geometry.arrays import Array
from ..geometry.least_squares import NormalEquations, levenberg_marquardt
from ..geometry.rigid_transform import kabsch
from ..markers.marker_set import MarkerSet

Pose = Callable[[Skeleton], Array]

_STEP_RAD = 1e-5
_LEAST_VARIANCE_M = 1e-3  # of a direction in which prototypes differ: below, it is left out

# standard deviations of the unknowns
_SEEN_M = 0.002  # of a marker, measurement and skin together
_OFFSET_M, _UNKNOWN_OFFSET_M = 0.010, 0.030  # of a marker about its usual place, and about its joint where it has none
_SIDE_SHARE = 0.25  # of the mixture, by which a side differs from the body's middle
_PLACES_M = {"femur": 0.008, "humerus": 0.014}  # of hip and shoulder joints, each way, in bodies of one size
_LENGTHS = {"tibia": 0.04, "foot": 0.04, "radius": 0.05, "wrist": 0.05, "hand": 0.05}  # of segments, relative
_OWN_SHARE = 0.5  # of these, by which a side differs from what both share
# of joint angles about those of the pose, degrees, and the axes they are about
_LIMB_ANGLES_DEG = {"humerus": (8.0, "xyz"), "hand": (6.0, "yz"), "femur": (6.0, "xyz"), "foot": (4.0, "xyz")}
_HINGES_DEG = {"radius": 8.0, "tibia": 8.0}
# the first pose says what an upright trunk is; in the others it may differ from it
_TRUNK_ANGLES_DEG = {("lowerback", "upperback", "thorax"): 8.0, ("lowerneck", "upperneck", "head"): 10.0}
_COLLAR_DEG = 10.0
_PARENTS = {"tibia": "femur", "foot": "tibia", "radius": "humerus", "wrist": "radius", "hand": "wrist"}
_PARENTS |= {"humerus": "clavicle"}


@dataclass(frozen=True)
class BodyFit:
    """The most probable body and how it stood.

    Args:
        rotations: (N, J, 4) of each pose.
        root_positions_m: (N, 3) of each pose.
        astray_rad: per pose, the angle by which the upper joints of arms and legs are off the pose, by joint name.
        sigmas_m: (J,) standard deviation of each joint's distance from its parent that is left (0 of a known body).
    """

    skeleton: Skeleton
    rotations: Array
    root_positions_m: Array
    astray_rad: tuple[dict[str, float], ...]
    sigmas_m: Array


def fit_body(points_m: Array, marker_set: MarkerSet, prototypes: Sequence[Skeleton], poses: Sequence[Pose]) -> BodyFit:
    """Return the body that shows the points in the poses.

    Args:
        points_m: (N, M, 3) markers of each pose in any world, NaN where unseen; at least three torso markers of each.
        marker_set: its joints, and its usual offsets where it has them.
        prototypes: bodies of many sizes with the standard skeleton's joints; a single one is taken as known.
        poses: N poses, of which the first has the trunk just so.
    """
    body = _BodyPrior(prototypes)
    fit = _Fit(points_m, marker_set, body, [_HeldPose(pose, body.skeleton(), i == 0) for i, pose in enumerate(poses)])
    return fit.solved()


class _BodyPrior:
    """Bodies as a mean and directions with coefficients of unit deviation."""

    def __init__(self, prototypes: Sequence[Skeleton]) -> None:
        self.like = prototypes[0]
        shapes = np.array([np.concatenate((p.offsets_m, p.tips_m), axis=1) for p in prototypes])
        self.mean = shapes.mean(axis=0)
        self.directions = np.zeros((0, *self.mean.shape))
        if len(prototypes) > 1:
            mixed = self._mixed(shapes)
            names = self.like.names
            sides = np.array([name[0] if mirrored_name(name) != name else "m" for name in names])
            one_side = [np.where((sides == side)[:, None], _SIDE_SHARE * mixed, 0.0) for side in "lr"]
            self.directions = np.concatenate((mixed, *one_side, self._own()))

    def skeleton(self, coefficients: Array | float = 0.0) -> Skeleton:
        """Return the body of coefficients (K)."""
        weights = np.broadcast_to(coefficients, len(self.directions))
        shape = self.mean + np.tensordot(weights, self.directions, 1)
        like = self.like
        return Skeleton(like.names, like.parents, shape[:, :3], shape[:, 3:], like.angle_axes, like.angle_orders)

    def _mixed(self, shapes: Array) -> Array:
        """Return the directions of difference between prototypes."""
        count = len(shapes)
        _, spread, axes = np.linalg.svd((shapes - self.mean).reshape(count, -1), full_matrices=False)
        deviations = spread / np.sqrt(count - 1)
        kept = deviations > _LEAST_VARIANCE_M
        return (deviations[kept, None] * axes[kept]).reshape(-1, *self.mean.shape)

    def _own(self) -> Array:
        """Return further differences of bodies: joint places and segment lengths."""
        result = []
        for joint, sigma in _PLACES_M.items():
            for axis in np.eye(3):
                mirror = np.array([-1.0, 1.0, 1.0])
                result += _with_sides(*(self._moved(side + joint, sigma * (axis if side == "l" else mirror * axis))
                                        for side in "lr"))  # fmt: skip
        for joint, share in _LENGTHS.items():
            offsets = [self.mean[self.like.index(side + joint), :3] for side in "lr"]
            result += _with_sides(
                *(self._moved(side + joint, share * offset) for side, offset in zip("lr", offsets, strict=True))
            )
        return np.array(result)

    def _moved(self, joint: str, change_m: Array) -> Array:
        """Return the change of shape (J, 6) that moves a joint and the bone to it."""
        result = np.zeros_like(self.mean)
        result[self.like.index(joint), :3] = change_m
        if joint[1:] in _PARENTS:
            result[self.like.index(joint[0] + _PARENTS[joint[1:]]), 3:] = change_m
        return result


def _with_sides(left: Array, right: Array) -> list[Array]:
    """Return a change of both sides, and that of each alone."""
    return [left + right, _OWN_SHARE * left, _OWN_SHARE * right]


class _HeldPose:
    """A calibration pose with the angles of error around it.

    The feet stand flat on the floor however the legs are bent, so their orientation is given against the root's.
    """

    def __init__(self, pose: Pose, skeleton: Skeleton, first: bool) -> None:
        self.asked = pose(skeleton)
        self.asked[0] = rot.identity()
        self.feet = [skeleton.index(side + "foot") for side in "lr"]
        world = forward_kinematics(skeleton, self.asked, np.zeros(3))[1]
        self.asked[self.feet] = world[self.feet]
        self.turns, self.sigmas_rad = self._angles(skeleton, first)

    def _angles(self, skeleton: Skeleton, first: bool) -> tuple[Array, Array]:
        """Return unit rotation vectors (A, J, 3) and deviations (A,) of the angles."""
        rows: list[tuple[tuple[str, ...], Array, float]] = []
        axes = dict(zip("xyz", np.eye(3), strict=True))
        for side in "lr":
            for joint, (sigma, letters) in _LIMB_ANGLES_DEG.items():
                rows += [((side + joint,), axes[letter], sigma) for letter in letters]
            leg = skeleton.tips_m[skeleton.index(f"{side}femur")] * [1.0, 1.0, 0.0]
            knee = np.cross(leg / np.linalg.norm(leg), [0.0, 0.0, 1.0])
            for joint, axis in (("radius", axes["y"]), ("tibia", -knee)):
                rows.append(((side + joint,), axis, _HINGES_DEG[joint]))
            if not first:
                rows += [((f"{side}clavicle",), axes[letter], _COLLAR_DEG) for letter in "yz"]
        if not first:
            rows += [(joints, axis / len(joints), s) for joints, s in _TRUNK_ANGLES_DEG.items() for axis in np.eye(3)]
        turns = np.zeros((len(rows), len(skeleton), 3))
        for row, (joints, axis, _) in zip(turns, rows, strict=True):
            row[[skeleton.index(joint) for joint in joints]] = axis
        return turns, np.radians([sigma for _, _, sigma in rows])

    def local(self, angles_rad: Array, skeleton: Skeleton) -> Array:
        """Return local rotations (..., J, 4) for angles (..., A) added to the pose."""
        turn = rot.from_rotation_vector(np.tensordot(angles_rad, self.turns, 1))
        result = rot.multiply(np.broadcast_to(self.asked, turn.shape), turn)
        for foot in self.feet:
            tibia = int(skeleton.parents[foot])
            above = rot.multiply(result[..., int(skeleton.parents[tibia]), :], result[..., tibia, :])
            result[..., foot, :] = rot.multiply(rot.conjugate(above), result[..., foot, :])
        return result

    def astray(self, angles_rad: Array, skeleton: Skeleton) -> dict[str, float]:
        """Return the angle between each limb's first joint and the pose."""
        vectors = np.tensordot(angles_rad, self.turns, 1)
        joints = [side + joint for side in "lr" for joint in ("humerus", "femur")]
        return {joint: float(np.linalg.norm(vectors[skeleton.index(joint)])) for joint in joints}


@dataclass
class _State:
    """Unknowns of the fit: body, offsets, angles, and the place of each pose."""

    body: Array
    offsets: Array
    angles: list[Array]
    matrices: list[Array]
    places: list[Array]


class _Fit:
    def __init__(self, points_m: Array, marker_set: MarkerSet, body: _BodyPrior, held: list[_HeldPose]) -> None:
        self.points, self.body, self.held = points_m, body, held
        self.joints = marker_set.joint_indices(body.like)
        self.torso = marker_set.torso
        self.usual = usual_offsets(marker_set)
        known = np.array([marker.offset_m is not None for marker in marker_set.markers])
        self.offset_sigmas = np.where(known, _OFFSET_M, _UNKNOWN_OFFSET_M)[:, None]
        # which joints' offsets a marker's place is the sum of
        self.carried = body.like.is_ancestor[self.joints].astype(np.float64)
        self.carried[:, 0] = 0.0

    def solved(self) -> BodyFit:
        """Return the fit from the middle body in the exact poses."""
        state, near = levenberg_marquardt(self._start(), self._linearise, self._moved)
        return self._result(state, np.linalg.inv(near.matrix))

    def _start(self) -> _State:
        body, offsets = np.zeros(len(self.body.directions)), np.zeros((len(self.joints), 3))
        skeleton = self.body.skeleton()
        angles, matrices, places = [], [], []
        for held, points in zip(self.held, self.points, strict=True):
            angles.append(np.zeros(len(held.turns)))
            seen = np.isfinite(points[:, 0])
            local = self._markers(held, angles[-1], skeleton, self.usual)[0]
            # limbs may be held elsewhere: they only decide where the torso's markers lie nearly on a line
            weights = np.where(self.torso, 1.0, 0.05)[seen]
            matrix, place = kabsch(local[seen], points[seen], weights)
            matrices.append(matrix)
            places.append(place)
        return _State(body, offsets, angles, matrices, places)

    def _markers(self, held: _HeldPose, angles: Array, skeleton: Skeleton, offsets: Array) -> tuple[Array, Array]:
        """Return markers (..., M, 3) and joint orientations in the root's frame."""
        positions, world = forward_kinematics(skeleton, held.local(angles, skeleton), np.zeros(3))
        return positions[..., self.joints, :] + rot.rotate(world[..., self.joints, :], offsets), world

    def _shape(self, state: _State) -> tuple[Skeleton, Array]:
        return self.body.skeleton(state.body), self.usual + self.offset_sigmas * state.offsets

    def _linearise(self, state: _State) -> NormalEquations:
        """Return the normal equations of the squares over their variances."""
        skeleton, offsets = self._shape(state)
        prior = [state.body, state.offsets.ravel()]
        for angles, held in zip(state.angles, self.held, strict=True):
            prior += [angles / held.sigmas_rad, np.full(6, np.nan)]
        values = np.concatenate(prior)
        free = np.isnan(values)  # root of each pose
        normal = np.diag(np.where(free, 0.0, 1.0))
        gradient = np.where(free, 0.0, values)
        cost = float(gradient @ gradient)
        first = len(state.body) + state.offsets.size
        for i, held in enumerate(self.held):
            columns, error = self._columns(state, i, skeleton, offsets)
            here = np.r_[0 : len(state.body) + state.offsets.size, first : first + len(held.turns) + 6]
            normal[np.ix_(here, here)] += columns.T @ columns
            gradient[here] += columns.T @ error
            cost += float(error @ error)
            first += len(held.turns) + 6
        return NormalEquations(normal, gradient, cost)

    def _columns(self, state: _State, i: int, skeleton: Skeleton, offsets: Array) -> tuple[Array, Array]:
        """Return Jacobian and error of a pose's seen markers.

        Columns: body, offsets, angles, the root's turn and place.
        """
        held, count = self.held[i], len(self.joints)
        angles = len(held.turns)
        tried = state.angles[i] + np.concatenate((np.zeros((1, angles)), _STEP_RAD * np.eye(angles)))
        markers, orientations = self._markers(held, tried, skeleton, offsets)
        local, world = markers[0], rot.to_matrix(orientations[0])
        above = world[np.maximum(skeleton.parents, 0)]
        by_body = np.einsum("mj,jxy,kjy->kmx", self.carried, above, self.body.directions[:, :, :3])
        by_offset = np.zeros((count, 3, count, 3))
        by_offset[np.arange(count), :, np.arange(count)] = self.offset_sigmas[:, :, None] * np.swapaxes(
            world[self.joints], 1, 2
        )
        by_angle = held.sigmas_rad[:, None, None] * (markers[1:] - local) / _STEP_RAD
        by_turn = np.cross(np.eye(3)[:, None], local)
        in_root = np.concatenate((by_body, by_offset.reshape(3 * count, count, 3), by_angle, by_turn))
        by_place = np.broadcast_to(np.eye(3)[:, None], (3, count, 3))
        columns = np.concatenate((in_root @ state.matrices[i].T, by_place))
        error = local @ state.matrices[i].T + state.places[i] - self.points[i]
        seen = np.isfinite(error[:, 0])
        return columns[:, seen].reshape(len(columns), -1).T / _SEEN_M, error[seen].ravel() / _SEEN_M

    def _moved(self, state: _State, step: Array) -> _State:
        shared = len(state.body) + state.offsets.size
        result = _State(
            state.body + step[: len(state.body)],
            state.offsets + step[len(state.body) : shared].reshape(-1, 3),
            [],
            [],
            [],
        )
        first = shared
        for i, held in enumerate(self.held):
            part = step[first : first + len(held.turns) + 6]
            result.angles.append(state.angles[i] + held.sigmas_rad * part[:-6])
            result.matrices.append(state.matrices[i] @ rot.to_matrix(rot.from_rotation_vector(part[-6:-3])))
            result.places.append(state.places[i] + part[-3:])
            first += len(part)
        return result

    def _result(self, state: _State, covariance: Array) -> BodyFit:
        skeleton, _ = self._shape(state)
        rotations = []
        for i, held in enumerate(self.held):
            local = held.local(state.angles[i], skeleton)
            local[0] = rot.from_matrix(state.matrices[i])
            rotations.append(local)
        length = np.maximum(np.linalg.norm(skeleton.offsets_m, axis=1, keepdims=True), 1e-9)
        along = np.einsum("kjx,jx->jk", self.body.directions[:, :, :3], skeleton.offsets_m / length)
        shape = covariance[: len(state.body), : len(state.body)]
        return BodyFit(
            skeleton,
            np.array(rotations),
            np.array(state.places),
            tuple(held.astray(angles, skeleton) for held, angles in zip(self.held, state.angles, strict=True)),
            np.sqrt(np.einsum("jk,kl,jl->j", along, shape, along)),
        )


def usual_offsets(marker_set: MarkerSet) -> Array:
    """Return usual offsets (M, 3), zero (on the joint) where the set has none."""
    return np.array([marker.offset_m or (0.0, 0.0, 0.0) for marker in marker_set.markers])
