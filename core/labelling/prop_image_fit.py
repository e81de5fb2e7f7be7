"""Fit of a prop's pose to its blobs in all images, including those that only one camera sees."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..geometry import rotations as rot
from ..geometry.arrays import Array, IntArray
from ..geometry.camera import Camera
from ..geometry.least_squares import gauss_newton
from ..geometry.rigid_transform import transform
from ..markers.marker_frame import MarkerFrame, undistort_blobs
from ..markers.prop import Prop


@dataclass(frozen=True)
class PropFitSettings:
    """Settings of `PropImages.fit`."""

    steps: int = 6  # largest number of Gauss-Newton steps
    small_step: float = 1e-5  # size of a step, rad and m, that ends the fit
    least_depth_m: float = 0.1
    centre_px: float = 0.3  # scale of the robust weights, about the errors of blob centres and calibration
    damping: float = 1e-6  # far below the information from one blob; keeps undetermined directions in place


_S = PropFitSettings()


@dataclass(frozen=True)
class Placed:
    """A prop's pose at one moment: x_world = turn x_prop + shift."""

    turn: Array
    shift: Array
    time_s: float

    def markers(self, prop: Prop) -> Array:
        """Return the prop's markers (M, 3) in the world."""
        return transform(self.turn, self.shift, prop.positions_m)


class PropImages:
    """Images of a frame, in which a prop's projected markers are compared with the blobs."""

    def __init__(self, cameras: Sequence[Camera], frame: MarkerFrame, prop: Prop) -> None:
        self._cameras = cameras
        self._markers = prop.positions_m
        self._pixels = [blobs[:, :2].astype(np.float64) for blobs in frame.blobs]
        self._normalised = undistort_blobs(frame, cameras).normalised
        self._rotations = np.stack([camera.rotation for camera in cameras])
        self._shifts = np.stack([camera.translation_m for camera in cameras])
        self._focal_px = np.array([camera.focal_px for camera in cameras])

    def nearest(self, placed: Placed, limits_px: float | Array) -> IntArray:
        """Return the nearest blob (M, C) to each marker in each image if the marker is also nearest to it, else -1.

        Args:
            limits_px: Largest distance: one for all images, or one for each (C, 1).
        """
        world = transform(placed.turn, placed.shift, self._markers)
        result = np.full((len(world), len(self._cameras)), -1, dtype=np.int64)
        limits = np.broadcast_to(np.asarray(limits_px, dtype=np.float64), result.T.shape)
        for index, camera in enumerate(self._cameras):
            if len(self._pixels[index]) == 0:
                continue
            away = np.linalg.norm(camera.project(world)[:, None] - self._pixels[index][None], axis=-1)
            away = np.where(np.isnan(away), np.inf, away)
            blob = np.argmin(away, axis=1)
            own = np.argmin(away, axis=0)[blob] == np.arange(len(world))
            result[:, index] = np.where(own & (away.min(axis=1) < limits[index]), blob, -1)
        return result

    def pixels_of(self, placed: Placed, metres: float) -> Array:
        """Return the length (C, 1) in pixels, in each image, of a distance at the prop's depth."""
        middle = placed.turn @ self._markers.mean(axis=0) + placed.shift
        depth = np.maximum((self._rotations @ middle + self._shifts)[:, 2], _S.least_depth_m)
        return np.asarray(metres * self._focal_px / depth)[:, None]

    def fit(self, placed: Placed, blobs: IntArray) -> tuple[Placed, Array]:
        """Return the pose that best explains the blobs (M, C), and their errors (M, C), pixels.

        Robust weights (Cauchy's) leave a few wrong blobs little influence.
        """
        seen = blobs >= 0
        observed = np.zeros((*blobs.shape, 2))
        for index, coordinates in enumerate(self._normalised):
            shown = seen[:, index]
            observed[shown, index] = coordinates[blobs[shown, index]]

        def projected(turn: Array, shift: Array) -> tuple[Array, Array, Array]:
            arms = self._markers @ turn.T
            local = np.einsum("cij,mj->mci", self._rotations, arms + shift) + self._shifts
            depth = np.maximum(local[..., 2], _S.least_depth_m)[..., None]
            return arms, depth, local[..., :2] / depth

        def linearise(pose: tuple[Array, Array]) -> tuple[Array, Array]:
            arms, depth, points = projected(*pose)
            residual = ((points - observed) * self._focal_px[:, None])[seen]
            slope = self._rotations[None, :, :2] - points[..., None] * self._rotations[None, :, 2:3]
            by_point = slope / depth[..., None] * self._focal_px[:, None, None]
            by_turn = rot.cross(arms[:, None, None], by_point)
            jacobian = np.concatenate((by_turn, by_point), axis=-1)[seen]
            weights = 1.0 / np.hypot(1.0, np.linalg.norm(residual, axis=-1, keepdims=True) / _S.centre_px)
            rows = ((weights * residual).ravel(), (weights[..., None] * jacobian).reshape(-1, 6))
            return np.append(rows[0], np.zeros(6)), np.concatenate((rows[1], np.sqrt(_S.damping) * np.eye(6)))

        def move(pose: tuple[Array, Array], step: Array) -> tuple[Array, Array]:
            return rot.to_matrix(rot.from_rotation_vector(-step[:3])) @ pose[0], pose[1] - step[3:]

        pose, _, _ = gauss_newton((placed.turn, placed.shift), linearise, _S.steps, smallest=_S.small_step, move=move)
        errors = np.linalg.norm((projected(*pose)[2] - observed) * self._focal_px[:, None], axis=-1)
        return Placed(*pose, placed.time_s), np.where(seen, errors, np.inf)

    def off_m(self, placed: Placed, blobs: IntArray) -> float:
        """Return the RMS distance of the markers from their blobs' rays, metres."""
        world = transform(placed.turn, placed.shift, self._markers)
        squares = []
        for index, camera in enumerate(self._cameras):
            shown = np.flatnonzero(blobs[:, index] >= 0)
            rays = camera.rays(self._normalised[index][blobs[shown, index]])
            arms = world[shown] - camera.centre_m
            off = arms - np.sum(arms * rays, axis=1, keepdims=True) * rays
            squares += np.sum(off * off, axis=1).tolist()
        return float(np.sqrt(np.mean(squares)))
