"""Fit of poses to joint targets near the database's motion, using the solver's fit to markers."""

from dataclasses import dataclass

import numpy as np

from ..body.body_parts import PARTS
from ..body.skeleton import Skeleton
from ..database.store import Database, pose_from_rotations
from ..geometry import rotations as rot
from ..geometry.arrays import Array
from ..markers.marker_set import Marker, MarkerSet
from ..markers.subject import Subject
from ..solver.gaussian_conditioning import Expectation, Prior, fit_to_markers
from ..solver.observation import Observation
from ..solver.subject_model import RootPose, SubjectModel

_HINGES = ("lradius", "rradius", "ltibia", "rtibia")
_LIMBS = [
    (*PARTS[f"{side} {upper}"], *PARTS[f"{side} {lower}"])
    for side in ("left", "right")
    for upper, lower in (("arm", "hand"), ("leg", "foot"))
]


@dataclass(frozen=True)
class PoseFitSettings:
    """Settings of the fit."""

    steps: int = 20  # most Gauss-Newton steps in one round
    rounds: int = 3  # most rounds; a frame that misses a tight target is fitted again from its result
    near_m: float = 0.01  # largest distance from a target that is met
    tight_m: float = 0.002  # standard deviation below which a target is tight
    straight_rad: float = 0.02  # the iteration ends after a step in which no joint turns more than this
    marker_sigma_m: float = 0.0005
    change_share: float = 0.1  # factor of the database's covariance for a pose's covariance about its motion
    change_rad: float = 0.02  # additional standard deviation of each angle
    root_sigma: tuple[float, float] = (0.05, 0.015)  # m, rad; relative to the database's motion
    limit_percentiles: tuple[float, float] = (0.5, 99.5)  # percentiles of the database's angles used as joint limits
    limit_margin_rad: float = 0.05  # margin by which these joint limits are widened
    most_beyond_rad: float = 0.35  # largest angle of a joint beyond its limits
    samples: int = 4000  # database frames used to estimate covariance and limits


class PoseFit:
    """Fits poses of one skeleton to targets of its joints.

    Args:
        joints: Names (M) of the joints with targets, at least three.
    """

    def __init__(
        self,
        skeleton: Skeleton,
        database: Database,
        joints: tuple[str, ...],
        settings: PoseFitSettings = PoseFitSettings(),
    ) -> None:
        self._settings = settings
        markers = tuple(Marker(name, name, (0.0, 0.0, 0.0), torso=True) for name in joints)
        subject = Subject("sketch", skeleton, MarkerSet("sketch", markers))
        reference = database.reference_pose_of(skeleton)
        self._model = SubjectModel(subject, reference)
        frames = np.arange(0, database.frames, max(1, database.frames // settings.samples))
        poses = np.asarray(database.poses[frames], dtype=np.float64).reshape(len(frames), -1)
        self._covariance = settings.change_share * np.atleast_2d(np.cov(poses.T, ddof=0))
        self._covariance[np.diag_indices_from(self._covariance)] += settings.change_rad**2
        # limbs without targets are independent of the rest: feet keyed wider apart than in any clip would raise arms
        for own in (np.repeat(np.isin(skeleton.names[1:], limb), 3) for limb in _LIMBS if not set(limb) & set(joints)):
            self._covariance[np.ix_(own, ~own)] = self._covariance[np.ix_(~own, own)] = 0.0
        low, high = np.percentile(poses, settings.limit_percentiles, axis=0)
        low, high = low - settings.limit_margin_rad, high + settings.limit_margin_rad
        # everyone can stretch arms and legs, even where the database's motion never does
        straight = pose_from_rotations(np.tile(rot.identity(), (len(skeleton), 1)), reference).ravel()
        hinges = np.isin(np.repeat(skeleton.names[1:], 3), _HINGES)
        self._limits = np.array(
            (
                np.where(hinges, np.minimum(low, straight), low),
                np.where(hinges, np.maximum(high, straight), high),
            )
        )

    def fit(self, poses: Array, roots: RootPose, points_m: Array, sigmas_m: Array) -> tuple[Array, RootPose]:
        """Return poses (F, 28, 3) and roots (F) that meet targets and stay near the given poses and roots.

        Args:
            points_m: Targets (F, M, 3) in world axes.
            sigmas_m: Standard deviations (F, M) of the targets.
        """
        settings = self._settings
        flat, rotations, places = poses.reshape(len(poses), -1), roots.rotation.copy(), roots.position_m.copy()
        # angles in the database's own motion never violate a limit
        limits = np.stack((np.minimum(self._limits[0], flat), np.maximum(self._limits[1], flat)), axis=1)
        flat, left = flat.copy(), np.arange(len(flat))
        for number in range(settings.rounds + 1):
            if number == settings.rounds:  # frames that are stuck restart from the nearest fitted frame
                free = np.setdiff1d(np.arange(len(flat)), left)
                if not len(free):
                    break
                others = free[np.argmin(np.abs(left[:, None] - free), axis=1)]
                flat[left], rotations[left] = flat[others], rotations[others]
            for at in left:
                observation = Observation.of_points(points_m[at], sigmas_m[at])
                expectation = Expectation(
                    Prior(flat[at], self._covariance),
                    observation,
                    RootPose(rotations[at], places[at]),
                    settings.root_sigma,
                    limits[at],
                )
                pose, root, _ = fit_to_markers(
                    expectation, self._model, settings.marker_sigma_m, settings.steps, settings.straight_rad
                )
                # impossible targets pull without limit, so clip: no joint may go far beyond its limits
                flat[at] = np.clip(
                    pose, limits[at, 0] - settings.most_beyond_rad, limits[at, 1] + settings.most_beyond_rad
                )
                rotations[at], places[at] = root.rotation, root.position_m
            root = RootPose(rotations[left], places[left])
            away_m = self._model.markers(flat[left].reshape(len(left), -1, 3), root) - points_m[left]
            far = (np.linalg.norm(away_m, axis=2) >= settings.near_m) & (sigmas_m[left] < settings.tight_m)
            left = left[far.any(axis=1)]
            if not len(left):
                break
        return flat.reshape(poses.shape), RootPose(rotations, places)
