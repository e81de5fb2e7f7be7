"""Time offsets between cameras, from moving markers.

A marker that moves across the epipolar lines is off them when the two images are of different moments. So the distance
of blobs of one camera from the epipolar lines of the other's, taken at a shifted time from their tracks in the image,
is least where the shift is the offset. First a grid of offsets finds roughly where that is and the tracks that belong
together; then offset and drift are refined by Gauss-Newton with Cauchy's weights, all tracks at once.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...geometry.arrays import Array, IntArray
from ...geometry.camera import Camera, CameraRig
from ...markers.marker_frame import MarkerFrame
from .image_tracks import BlobLinker, ImageTracks, image_tracks
from .stereo import essential_matrix, homogeneous

_GRID_STEP_S = 0.004
_GRID_IMAGES, _IMAGES = 600, 6000  # of the reference are enough
_CAP_PX = 5.0  # a distance above this says no more than that the blobs are not the same marker
_FEWEST_SAMPLES = 12  # of two tracks side by side
_ROUNDS = 4
_STEPS = 3
_DIFFERENCE_FRAMES = 3.0
_LEAST_SCALE_PX = 0.05
_ACCEPTED = 3.0  # times the usual distance: tracks further apart on average are not one marker
_CERTAIN_S = 0.0005  # twice this is a millisecond: half a centimetre at 5 m/s
_SIGNIFICANT = 3.0
_DRIFT_SIGMA = 1e-3  # clocks differ by less
_BLOCK_S = 0.5  # errors within such a time go together


@dataclass(frozen=True)
class TimeOffset:
    """Time of a camera against the reference's.

    Args:
        offset_s: an image stamped t shows the moment t + offset_s + drift * (t - middle_s) of the reference's clock.
        drift: growth of the offset, seconds per second.
        middle_s: time stamp at which the offset is `offset_s`.
        sigma_s: standard deviation of the offset there; infinite when nothing could be found.
        samples: pairs of blobs that it was found from.
    """

    offset_s: float = 0.0
    drift: float = 0.0
    middle_s: float = 0.0
    sigma_s: float = np.inf
    samples: int = 0

    @property
    def is_found(self) -> bool:
        """Whether the motion determines an offset."""
        return bool(np.isfinite(self.sigma_s))

    @property
    def is_certain(self) -> bool:
        """Whether an offset is known well enough to be corrected."""
        return self.sigma_s < _CERTAIN_S and abs(self.offset_s) > _SIGNIFICANT * self.sigma_s

    def moment_s(self, stamp_s: float) -> float:
        """Return the moment that an image shows."""
        return stamp_s + self.offset_s + self.drift * (stamp_s - self.middle_s)


def estimate_time_offset(
    reference: Camera,
    camera: Camera,
    reference_tracks: ImageTracks,
    tracks: ImageTracks,
    largest_s: float,
    about_s: float = 0.0,
) -> TimeOffset:
    """Return the time offset of a camera against a reference camera.

    Args:
        reference, camera: calibrated together.
        reference_tracks, tracks: what each saw, at the times of its own stamps.
        largest_s: offsets up to this, either way from `about_s`, are looked for.
        about_s: offset that is known roughly.
    """
    if min(reference_tracks.points.size, tracks.points.size) == 0:
        return TimeOffset()
    rough = _Pair(reference, camera, reference_tracks.thin(_GRID_IMAGES), tracks)
    pair = _Pair(reference, camera, reference_tracks.thin(_IMAGES), tracks)
    steps = int(np.ceil(largest_s / _GRID_STEP_S))
    grid = about_s + _GRID_STEP_S * np.arange(-steps, steps + 1)
    offset, drift = float(grid[np.argmin([rough.score(shift) for shift in grid])]), 0.0
    refined = TimeOffset()
    for _ in range(_ROUNDS):
        refined = pair.refine(offset, drift)
        if not refined.is_found:
            return refined
        offset, drift = refined.offset_s, refined.drift
    return refined if abs(offset - about_s) <= largest_s + _GRID_STEP_S else TimeOffset()


class _Pair:
    """Tracks of two cameras, compared at shifted times."""

    def __init__(self, a: Camera, b: Camera, tracks_a: ImageTracks, tracks_b: ImageTracks) -> None:
        self.times_s = tracks_a.times_s
        self._middle_s = float(np.mean(self.times_s))
        self._focal_px = 0.5 * (a.focal_px + b.focal_px)
        self._a, self._b = tracks_a, tracks_b
        self._essential = essential_matrix(a, b)
        self._lines = homogeneous(tracks_a.points) @ self._essential.T

    def _distances(self, offset_s: float, drift: float) -> tuple[Array, IntArray]:
        """Return signed Sampson distances (A, B, F), pixels, and the other's tracks."""
        shift = offset_s + drift * (self.times_s - self._middle_s)
        points, ids = self._b.at(self.times_s - shift)
        y = homogeneous(points)
        value = np.einsum("afi,bfi->abf", self._lines, y)
        back = y @ self._essential
        slope = np.sum(self._lines[..., :2] ** 2, axis=-1)[:, None] + np.sum(back[..., :2] ** 2, axis=-1)[None]
        return value / np.sqrt(np.maximum(slope, 1e-30)) * self._focal_px, ids

    def _costs(self, distances: Array, ids: IntArray) -> Array:
        """Return capped mean squared distances of tracks (A, B, F); inf where none."""
        squares = np.minimum(distances**2, _CAP_PX**2)
        known = np.isfinite(squares)
        width = int(ids.max()) + 1
        keys = (self._a.ids[:, None] * width + ids[None])[known]
        values, index = np.unique(keys, return_inverse=True)
        counts = np.bincount(index, minlength=len(values))
        means = np.bincount(index, squares[known], minlength=len(values)) / np.maximum(counts, 1)
        means[counts < _FEWEST_SAMPLES] = np.inf
        costs = np.full(distances.shape, np.inf)
        costs[known] = means[index]
        return costs

    def score(self, offset_s: float) -> float:
        """Return how badly the tracks fit together at an offset."""
        distances, ids = self._distances(offset_s, 0.0)
        best = self._costs(distances, ids).min(axis=1)
        there = self._a.ids >= 0
        return float(np.minimum(best[there], _CAP_PX**2).sum())

    def refine(self, offset_s: float, drift: float) -> TimeOffset:
        """Refine offset and drift by Gauss-Newton, with the tracks that fit there."""
        distances, ids = self._distances(offset_s, drift)
        costs = self._costs(distances, ids)
        # each other's best
        chosen = np.isfinite(costs) & (costs == costs.min(axis=1, keepdims=True))
        chosen &= costs == costs.min(axis=0, keepdims=True)
        if not chosen.any():
            return TimeOffset()
        usual = float(np.median(costs[chosen]))
        chosen &= costs <= _ACCEPTED**2 * max(usual, _LEAST_SCALE_PX**2)
        a, b, f = np.nonzero(chosen)
        since = self.times_s[f] - self._middle_s
        state = np.array([offset_s, drift])
        # Velocities from other images than those that the distance is from: noise in both alike would be a bias,
        # towards the middle between two images, where the interpolated noise is least.
        apart_s = _DIFFERENCE_FRAMES * float(np.median(np.diff(self._b.times_s)))
        prior = np.diag([0.0, 1.0 / _DRIFT_SIGMA**2])
        for _ in range(_STEPS):
            ahead, here, behind = (
                self._distances(state[0] + step, state[1])[0][a, b, f] for step in (apart_s, 0.0, -apart_s)
            )
            usable = np.isfinite(ahead) & np.isfinite(here) & np.isfinite(behind)
            if usable.sum() < _FEWEST_SAMPLES:
                return TimeOffset()
            residual = here[usable]
            rate = ((ahead - behind)[usable]) / (2.0 * apart_s)
            jacobian = rate[:, None] * np.stack((np.ones(len(residual)), since[usable]), axis=1)
            scale = max(1.4826 * float(np.median(np.abs(residual))), _LEAST_SCALE_PX)
            weights = 1.0 / (scale**2 * (1.0 + (residual / (2.0 * scale)) ** 2))
            normal = jacobian.T @ (weights[:, None] * jacobian) + prior
            gradient = jacobian.T @ (weights * residual) + prior @ state
            state = state - np.linalg.lstsq(normal, gradient, rcond=None)[0]
        # what disturbs (calibration, overlapping blobs) lasts for some time: errors are summed over blocks of it
        block = ids[b, f][usable] * 100_000 + np.floor(self.times_s[f][usable] / _BLOCK_S).astype(np.int64)
        _, index = np.unique(block, return_inverse=True)
        parts = np.zeros((index.max() + 1, 2))
        np.add.at(parts, index, jacobian * (weights * residual)[:, None])
        inverse = np.linalg.pinv(normal)
        covariance = inverse @ (parts.T @ parts) @ inverse
        sigma = float(np.sqrt(max(covariance[0, 0], inverse[0, 0])))
        return TimeOffset(float(state[0]), float(state[1]), self._middle_s, sigma, int(usable.sum()))


def estimate_time_offsets(
    rig: CameraRig, frames: Sequence[MarkerFrame], largest_s: float, about: Sequence[TimeOffset] = ()
) -> tuple[TimeOffset, ...]:
    """Return each camera's time offset against the first, from blobs of frames.

    Args:
        frames: with the blobs as they are in the images, and the images' time stamps.
        largest_s: offsets up to this, either way, are looked for.
        about: offsets that are known roughly; `largest_s` is then counted from these.
    """
    tracks = [_tracks_of(camera, index, frames) for index, camera in enumerate(rig.cameras)]
    start = [offset.offset_s for offset in about] or [0.0] * len(rig)
    found = [
        estimate_time_offset(rig.cameras[0], rig.cameras[i], tracks[0], tracks[i], largest_s, start[i])
        for i in range(1, len(rig))
    ]
    return (TimeOffset(sigma_s=0.0), *found)


def _tracks_of(camera: Camera, index: int, frames: Sequence[MarkerFrame]) -> ImageTracks:
    linker = BlobLinker(camera.image_size[0])
    times: list[float] = []
    pixels: list[Array] = []
    ids: list[IntArray] = []
    for frame in frames:
        stamp_s = float(frame.camera_times_s[index])
        if np.isfinite(stamp_s) and (not times or stamp_s > times[-1]):
            times.append(stamp_s)
            pixels.append(frame.blobs[index][:, :2].astype(np.float64))
            ids.append(linker.link(stamp_s, pixels[-1]))
    if not times:
        return image_tracks([], [], [])
    points = camera.undistort(np.concatenate(pixels))
    return image_tracks(times, np.split(points, np.cumsum([len(rows) for rows in pixels])[:-1]), ids)
