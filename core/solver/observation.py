"""Observation: the labelled markers of one frame, as the solver uses them."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..geometry.arrays import Array, IntArray, Mask
from ..geometry.camera import Camera
from ..markers.source_noise import SourceNoise

_AXES, _ACROSS = np.eye(3), np.array([True, True, False])  # the first two axes are across a ray
_KEPT_GUESS = 0.3  # share of a guessed depth that is kept where the last pose shows the depth as well


@dataclass(frozen=True)
class Observation:
    """Markers of a marker set in one frame."""

    points_m: Array  # (M, 3) world positions, NaN where a marker was not located
    # (M,) index of the only camera that saw the marker, even if its depth was guessed; -1 if none or several did
    cameras: IntArray
    image_points: Array  # (M, 2) undistorted normalised coordinates in that camera, NaN elsewhere
    rig: tuple[Camera, ...] = ()  # cameras to which `cameras` refers
    # (M, 3) standard deviations of the coordinates along `controls`, metres; those of a ray across it; None if exact
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
    def controls(self) -> "Controls":
        """Rows that a fit brings to zero, three for each located marker, two for each on a ray."""
        located, single = self.located, self.single
        noise_m = np.zeros((len(located), 3)) if self.noise_m is None else self.noise_m
        axes, origins_m = np.tile(_AXES, (len(located), 1, 1)), self.points_m.copy()
        for marker in np.flatnonzero(self.cameras >= 0):  # two axes across its ray, and the depth if it was guessed
            camera = self.rig[self.cameras[marker]]
            if single[marker]:
                axes[marker, :2, 2] = -self.image_points[marker]
                origins_m[marker] = camera.centre_m
            else:
                x, y, z = camera.to_camera(self.points_m[marker])
                axes[marker, :2, 2] = -x / z, -y / z
            axes[marker] = axes[marker] @ camera.rotation
        rows = np.flatnonzero(located[:, None] | (single[:, None] & _ACROSS))
        markers = rows // 3
        return Controls(markers, axes.reshape(-1, 3)[rows], origins_m[markers], noise_m.ravel()[rows])


class Controls(NamedTuple):
    """R linear functions of an observation's markers, axis . (marker - origin), that are zero where it was exact."""

    markers: IntArray  # (R,) the marker of each row
    axes: Array  # (R, 3)
    origins_m: Array  # (R, 3)
    noise_m: Array  # (R,) standard deviations


def control_residual(observation: Observation, markers_m: Array) -> Array:
    """Return the differences (R,) of markers (M, 3) from the observation (Eq. 7), metres; see `Controls`."""
    markers, axes, origins_m, _ = observation.controls
    return np.asarray(np.add.reduce(axes * (markers_m.take(markers, axis=0) - origins_m), axis=-1))


def control_jacobian(observation: Observation, jacobian: Array) -> Array:
    """Return the Jacobian (R, n) of `control_residual` given that of the markers (M, 3, n)."""
    markers, axes, _, _ = observation.controls
    return np.asarray((axes[:, None] @ jacobian.take(markers, axis=0))[:, 0])


def control_sigmas(observation: Observation, least_m: float) -> Array:
    """Return the standard deviations (R,) of `control_residual`, metres."""
    return np.asarray(np.hypot(least_m, observation.controls.noise_m))
