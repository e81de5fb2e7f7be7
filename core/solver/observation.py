"""Observation: the labelled markers of one frame, as the solver uses them."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..geometry.arrays import Array, IntArray, Mask
from ..geometry.camera import Camera
from ..markers.source_noise import SourceNoise

_KEPT_GUESS = 0.3  # share of a guessed depth that is kept where the last pose shows the depth as well


@dataclass(frozen=True)
class Observation:
    """Markers of a marker set in one frame."""

    points_m: Array  # (M, 3) world positions, NaN where a marker was not located
    # (M,) index of the only camera that saw the marker, even if its depth was guessed; -1 if none or several did
    cameras: IntArray
    image_points: Array  # (M, 2) undistorted normalised coordinates in that camera, NaN elsewhere
    rig: tuple[Camera, ...] = ()  # cameras to which `cameras` refers
    # (M, 3) standard deviations of the coordinates along `axes`, metres; those of a ray across it; None if exact
    noise_m: Array | None = None

    @classmethod
    def of_points(cls, points_m: Array, noise_m: Array | None = None) -> "Observation":
        """Return an observation of located markers only."""
        count = len(points_m)
        noise_m = None if noise_m is None else np.repeat(noise_m[:, None], 3, axis=1)
        return cls(points_m, np.full(count, -1, dtype=np.int64), np.full((count, 2), np.nan), noise_m=noise_m)

    def smoothed(self, points_m: Array, noise_m: Array, source: SourceNoise) -> "Observation":
        """Return the observation with other positions (M, 3) and their noise (M,); rays are unchanged."""
        points_m = np.where(self.single[:, None], np.nan, points_m)
        noise_m = np.repeat(np.where(self.single, source.across_m, noise_m)[:, None], 3, axis=1)
        noise_m[self.guessed, 2] = source.guessed_m
        return Observation(points_m, self.cameras, self.image_points, self.rig, noise_m)

    def without_guesses(self) -> "Observation":
        """Return the observation with rays instead of the markers whose depth was guessed."""
        return replace(self, points_m=np.where(self.guessed[:, None], np.nan, self.points_m))

    def back_projected(self, markers_m: Array) -> "Observation":
        """Return the observation with single-camera markers on their rays, as close as possible to markers (M, 3).

        Guessed depths are moved part of the way. Root and search use these points. The pose is fitted to the rays
        themselves, because the error of the points lies along the rays.
        """
        alone = np.flatnonzero(self.single | self.guessed)
        if not len(alone):
            return self
        points = self.points_m.copy()
        for marker in alone:
            camera = self.rig[self.cameras[marker]]
            ray = camera.rays(self.image_points[marker])
            nearest_m = camera.centre_m + ray * float(ray @ (markers_m[marker] - camera.centre_m))
            kept = _KEPT_GUESS if self.guessed[marker] else 0.0
            points[marker] = kept * np.nan_to_num(points[marker]) + (1.0 - kept) * nearest_m
        return replace(self, points_m=points)

    def with_torso_in_space(self, torso: Mask, markers_m: Array | None) -> "Observation":
        """Return the observation, back-projected if depths are guessed or fewer than three torso markers are located.

        Args:
            markers_m: Expected markers (M, 3); None if unknown.
        """
        if markers_m is None or np.count_nonzero(torso & self.located & ~self.guessed) >= 3:
            return self
        return self.back_projected(markers_m)

    @cached_property
    def located(self) -> Mask:
        """Mask (M,) of located markers."""
        return np.asarray(np.logical_and.reduce(np.isfinite(self.points_m), axis=-1))

    @cached_property
    def seen(self) -> Mask:
        """Mask (M,) of markers that any camera sees."""
        return self.located | (self.cameras >= 0)

    @cached_property
    def single(self) -> Mask:
        """Mask (M,) of markers that only one camera sees."""
        return (self.cameras >= 0) & ~self.located

    @cached_property
    def guessed(self) -> Mask:
        """Mask (M,) of located markers that only one camera sees, so that their depth is a guess."""
        return (self.cameras >= 0) & self.located

    @cached_property
    def axes(self) -> Array:
        """Matrices (M, 3, 3) from world axes to those of the errors: of a guess two across its ray, and the depth."""
        axes = np.broadcast_to(np.eye(3), (len(self.points_m), 3, 3)).copy()
        for marker in np.flatnonzero(self.guessed):
            camera = self.rig[self.cameras[marker]]
            x, y, z = camera.to_camera(self.points_m[marker])
            axes[marker, :2, 2] = -x / z, -y / z
            axes[marker] = axes[marker] @ camera.rotation
        return axes


def control_residual(observation: Observation, markers_m: Array) -> Array:
    """Return the differences of markers (M, 3) from the observation (Eq. 7), metres.

    There are three rows for each located marker, then two for the distance of each single-camera marker from its ray.
    """
    located, single = observation.located, observation.single
    away_m = markers_m[located] - observation.points_m[located]
    if observation.guessed.any():
        away_m = (observation.axes[located] @ away_m[..., None])[..., 0]
    parts = [away_m.ravel()]
    if not single.any():
        return np.asarray(parts[0])
    for marker in np.flatnonzero(single):
        camera = observation.rig[observation.cameras[marker]]
        x, y, z = camera.to_camera(markers_m[marker])
        u, v = observation.image_points[marker]
        parts.append(np.array([x - u * z, y - v * z]))
    return np.concatenate(parts)


def control_jacobian(observation: Observation, jacobian: Array) -> Array:
    """Return the Jacobian of `control_residual` given that of the markers (M, 3, n)."""
    located, single = observation.located, observation.single
    if observation.guessed.any():
        jacobian = observation.axes @ jacobian
    if located.all():
        return jacobian.reshape(-1, jacobian.shape[-1])
    parts = [jacobian[located].reshape(-1, jacobian.shape[-1])]
    if not single.any():
        return np.asarray(parts[0])
    for marker in np.flatnonzero(single):
        camera = observation.rig[observation.cameras[marker]]
        u, v = observation.image_points[marker]
        across = np.array([[1.0, 0.0, -u], [0.0, 1.0, -v]]) @ camera.rotation
        parts.append(across @ jacobian[marker])
    return np.concatenate(parts)


def control_sigmas(observation: Observation, least_m: float) -> Array:
    """Return the standard deviations of the rows of `control_residual`, metres."""
    located, single = observation.located, observation.single
    noise_m = np.zeros((len(located), 3)) if observation.noise_m is None else observation.noise_m
    sigmas_m = np.hypot(least_m, noise_m[located]).ravel()
    if not single.any():
        return sigmas_m
    return np.concatenate((sigmas_m, np.hypot(least_m, noise_m[single, :2]).ravel()))
