"""Fit of poses to targets of joints, near the database's motion.

The same cost as in `solver.gaussian_conditioning`, for many frames at once: there the prior differs from frame to
frame, here all share one, so its inverse is at hand and a step solves a system of the targets' size only.
"""

import numpy as np
from scipy.linalg import block_diag

from ..body.body_parts import PARTS
from ..body.skeleton import Skeleton
from ..database.store import Database, pose_from_rotations
from ..geometry import rotations as rot
from ..geometry.arrays import Array, Mask
from ..markers.marker_set import Marker, MarkerSet
from ..markers.subject import Subject
from ..solver.gaussian_conditioning import moved_root
from ..solver.subject_model import RootPose, SubjectModel

_STEPS = 20  # of Gauss-Newton at most,
_ROUNDS = 3  # and again from there while a tight target is further off than
_NEAR_M, _TIGHT_M = 0.01, 0.002
_STRAIGHT_RAD = 0.02  # a step in which no joint turns more needs no other
_FIRST_DAMPING, _DAMPING_GROWTH = 1.0, 4.0  # after steps that led away
_LIMIT_RAD = 0.02  # standard deviation beyond a joint's limit
_MARKER_SIGMA_M = 0.0005
_CHANGE_SHARE = 0.1  # of the database's covariance, with which a pose varies about its motion
_CHANGE_RAD = 0.02  # and beside that
_ROOT_SIGMA = (0.05, 0.015)  # m, rad, about the database's motion
_LIMIT_PERCENTILES, _LIMIT_MARGIN_RAD = (0.5, 99.5), 0.05  # of the database's joint angles
_MOST_BEYOND_RAD = 0.35
_HINGES = ("lradius", "rradius", "ltibia", "rtibia")
_SAMPLES = 4000  # frames that these are taken over
_LIMBS = [
    (*PARTS[f"{side} {upper}"], *PARTS[f"{side} {lower}"])
    for side in ("left", "right")
    for upper, lower in (("arm", "hand"), ("leg", "foot"))
]


class BodyFit:
    """Fits poses of one skeleton.

    Args:
        joints: names (M) of those with targets, at least three.
    """

    def __init__(self, skeleton: Skeleton, database: Database, joints: tuple[str, ...]) -> None:
        markers = tuple(Marker(name, name, (0.0, 0.0, 0.0), torso=True) for name in joints)
        subject = Subject("sketch", skeleton, MarkerSet("sketch", markers))
        self.reference_pose = database.reference_pose_of(skeleton)
        self._model = SubjectModel(subject, self.reference_pose)
        frames = np.arange(0, database.frames, max(1, database.frames // _SAMPLES))
        poses = np.asarray(database.poses[frames], dtype=np.float64).reshape(len(frames), -1)
        covariance = _CHANGE_SHARE * np.atleast_2d(np.cov(poses.T, ddof=0))
        covariance[np.diag_indices_from(covariance)] += _CHANGE_RAD**2
        # a limb without a target stays as the database moves it: feet keyed wide apart, as in no clip, raised the arms
        for own in (np.repeat(np.isin(skeleton.names[1:], limb), 3) for limb in _LIMBS if not set(limb) & set(joints)):
            covariance[np.ix_(own, ~own)] = covariance[np.ix_(~own, own)] = 0.0
        # of the change of root and pose
        self._covariance = block_diag(np.diag(np.repeat(np.array(_ROOT_SIGMA), 3) ** 2.0), covariance)
        self._precision = np.linalg.inv(self._covariance)
        margin = np.array([[-_LIMIT_MARGIN_RAD], [_LIMIT_MARGIN_RAD]])
        limits = np.percentile(poses, _LIMIT_PERCENTILES, axis=0) + margin
        # everybody can stretch out arms and legs, also where the database's motion never does
        straight = pose_from_rotations(np.tile(rot.identity(), (len(skeleton), 1)), self.reference_pose).ravel()
        hinges = np.isin(np.repeat(skeleton.names[1:], 3), _HINGES)
        reached = np.array((np.minimum(limits[0], straight), np.maximum(limits[1], straight)))
        self._limits = np.where(hinges, reached, limits)

    def fit(self, poses: Array, roots: RootPose, points_m: Array, sigmas_m: Array) -> tuple[Array, RootPose]:
        """Return poses (F, 28, 3) and roots (F) near others that meet targets.

        Args:
            points_m: (F, M, 3).
            sigmas_m: (F, M) standard deviations.
        """
        flat, rotations, places = poses.reshape(len(poses), -1), roots.rotation.copy(), roots.position_m.copy()
        # what the database's motion itself has is no violation
        limits = np.array((np.minimum(self._limits[0], flat), np.maximum(self._limits[1], flat)))
        flat, left = flat.copy(), np.arange(len(flat))
        for number in range(_ROUNDS + 1):
            if number == _ROUNDS:  # stuck: on from the nearest frame that is not
                free = np.setdiff1d(np.arange(len(flat)), left)
                if not len(free):
                    break
                others = free[np.argmin(np.abs(left[:, None] - free), axis=1)]
                flat[left], rotations[left] = flat[others], rotations[others]
            root = RootPose(rotations[left], places[left])
            change = self._change(flat[left], root, points_m[left], sigmas_m[left], limits[:, left])
            root = moved_root(root, change)
            rotations[left], places[left] = root.rotation, root.position_m
            # impossible targets pull with any force: no joint goes far beyond its limits all the same
            low, high = limits[0, left] - _MOST_BEYOND_RAD, limits[1, left] + _MOST_BEYOND_RAD
            flat[left] = np.clip(flat[left] + change[:, 6:], low, high)
            away_m = self._model.markers(flat[left].reshape(len(left), -1, 3), root) - points_m[left]
            far = (np.linalg.norm(away_m, axis=2) >= _NEAR_M) & (sigmas_m[left] < _TIGHT_M)
            left = left[far.any(axis=1)]
            if not len(left):
                break
        return flat.reshape(poses.shape), RootPose(rotations, places)

    def _change(self, mean: Array, root: RootPose, points_m: Array, sigmas_m: Array, limits: Array) -> Array:
        """Return the changes (F, 6 + D) of roots and poses (F, D) that fit best.

        A Gauss-Newton step that raises the cost is taken back and damped in the prior's metric (Levenberg 1944).
        """
        count, size = len(mean), len(self._precision)
        change, kept = np.zeros((2, count, size))
        rows, slopes = np.zeros((count, 3 * points_m.shape[1], size)), np.zeros((count, size))
        is_beyond = np.zeros((count, size), dtype=np.bool_)
        damping, least, at = np.zeros(count), np.full(count, np.inf), np.arange(count)
        scales = 1.0 / np.hypot(_MARKER_SIGMA_M, sigmas_m)[:, :, None]
        for _ in range(_STEPS):
            pose, moved = (
                mean[at] + change[at, 6:],
                moved_root(RootPose(root.rotation[at], root.position_m[at]), change[at]),
            )
            markers, jacobian = self._model.markers_and_jacobian(pose.reshape(len(at), -1, 3), moved)
            off = ((markers - points_m[at]) * scales[at]).reshape(len(at), -1)
            beyond = (pose - np.clip(pose, *limits[:, at])) / _LIMIT_RAD
            pull = change[at] @ self._precision
            cost = np.sum(off**2, axis=1) + np.sum(beyond**2, axis=1) + np.sum(pull * change[at], axis=1)
            is_better = cost <= least[at]
            better, worse = at[is_better], at[~is_better]
            rows[better] = (jacobian * scales[at, :, None]).reshape(*off.shape, size)[is_better]
            is_beyond[better, 6:] = beyond[is_better] != 0.0
            slopes[better] = pull[is_better] + (off[is_better, None] @ rows[better])[:, 0]
            slopes[better, 6:] += beyond[is_better] / _LIMIT_RAD
            least[better], kept[better] = cost[is_better], change[better]
            damping[better] /= _DAMPING_GROWTH**2
            damping[worse] = np.maximum(_FIRST_DAMPING, _DAMPING_GROWTH * damping[worse])
            step = self._step(rows[at], is_beyond[at], slopes[at], damping[at])
            change[at] = kept[at] + step
            pose = mean[at] + change[at, 6:]
            passed = np.where(beyond == 0.0, np.abs(pose - np.clip(pose, *limits[:, at])), 0.0)
            at = at[np.maximum(np.abs(step[:, 3:]).max(axis=1), passed.max(axis=1)) >= _STRAIGHT_RAD]
            if not len(at):
                break
        change[at] = kept[at]  # their last step was not tried
        return change

    def _step(self, rows: Array, is_beyond: Mask, slopes: Array, damping: Array) -> Array:
        """Return the steps (F, D) of damped Gauss-Newton.

        The targets' rows (F, R, D) are far fewer than the pose's numbers, as are those beyond their limits (F, D): by
        Woodbury's identity only a system of their size is solved.
        """
        most = int(is_beyond.sum(axis=1).max())
        if most:
            which = np.argsort(~is_beyond, axis=1, kind="stable")[:, :most]
            frames, places = np.arange(len(rows))[:, None], np.arange(most)
            limits = np.zeros((len(rows), most, rows.shape[2]))
            limits[frames, places, which] = is_beyond[frames, which] / _LIMIT_RAD
            rows = np.concatenate((rows, limits), axis=1)
        share = 1.0 / (1.0 + damping)
        spread = (rows.reshape(-1, rows.shape[2]) @ self._covariance).reshape(rows.shape) * share[:, None, None]
        free = (slopes @ self._covariance) * share[:, None]
        inner = spread @ rows.transpose(0, 2, 1) + np.eye(rows.shape[1])
        held = np.linalg.solve(inner, rows @ free[:, :, None])
        return np.asarray((held.transpose(0, 2, 1) @ spread)[:, 0] - free)
