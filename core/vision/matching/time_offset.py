"""Time offsets between cameras, estimated from moving markers.

If two images show different moments, a marker that moves across the epipolar lines misses them. One camera's blobs,
shifted in time along their tracks, come closest to the epipolar lines of the other's when the shift equals the offset.
A grid search finds the offset roughly, and with it the tracks that belong together; Gauss-Newton steps with Cauchy
weights then refine offset and drift with all tracks.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...geometry.arrays import Array, IntArray
from ...geometry.camera import Camera, CameraRig
from ...geometry.least_squares import gauss_newton
from ...markers.marker_frame import MarkerFrame
from .image_tracks import BlobLinker, ImageTracks, image_tracks
from .matching_settings import MATCHING
from .stereo import essential_matrix, homogeneous


@dataclass(frozen=True)
class TimeOffset:
    """Timing of a camera: an image stamped t shows the reference's time t + offset_s + drift (t - middle_s)."""

    offset_s: float = 0.0
    drift: float = 0.0  # seconds per second
    middle_s: float = 0.0
    sigma_s: float = np.inf  # standard deviation of the offset at `middle_s`; infinite without a result
    samples: int = 0  # number of blob pairs in the estimate

    @property
    def is_found(self) -> bool:
        """Whether the motion determines an offset."""
        return bool(np.isfinite(self.sigma_s))

    @property
    def is_certain(self) -> bool:
        """Whether an offset is known well enough to be corrected."""
        return self.sigma_s < MATCHING.certain_s and abs(self.offset_s) > MATCHING.significant * self.sigma_s

    def moment_s(self, stamp_s: float) -> float:
        """Return the time that an image shows."""
        return stamp_s + self.offset_s + self.drift * (stamp_s - self.middle_s)


def estimate_time_offset(
    reference: Camera,
    camera: Camera,
    reference_tracks: ImageTracks,
    tracks: ImageTracks,
    largest_s: float,
    about_s: float = 0.0,
) -> TimeOffset:
    """Return the time offset of a camera relative to a reference camera.

    Args:
        reference_tracks, tracks: Tracks of the two cameras at the times of their own stamps.
        largest_s: Largest difference from `about_s`.
        about_s: Rough estimate of the offset.
    """
    if min(reference_tracks.points.size, tracks.points.size) == 0:
        return TimeOffset()
    rough = _Pair(reference, camera, reference_tracks.thin(MATCHING.grid_images), tracks)
    pair = _Pair(reference, camera, reference_tracks.thin(MATCHING.offset_images), tracks)
    steps = int(np.ceil(largest_s / MATCHING.grid_step_s))
    grid = about_s + MATCHING.grid_step_s * np.arange(-steps, steps + 1)
    offset, drift = float(grid[np.argmin([rough.score(shift) for shift in grid])]), 0.0
    refined = TimeOffset()
    for _ in range(MATCHING.rounds):
        refined = pair.refine(offset, drift)
        if not refined.is_found:
            return refined
        offset, drift = refined.offset_s, refined.drift
    return refined if abs(offset - about_s) <= largest_s + MATCHING.grid_step_s else TimeOffset()


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
        """Return signed Sampson distances (A, B, F), pixels, and the second camera's tracks (B, F)."""
        shift = offset_s + drift * (self.times_s - self._middle_s)
        points, ids = self._b.at(self.times_s - shift)
        y = homogeneous(points)
        value = np.einsum("afi,bfi->abf", self._lines, y)
        back = y @ self._essential
        slope = np.sum(self._lines[..., :2] ** 2, axis=-1)[:, None] + np.sum(back[..., :2] ** 2, axis=-1)[None]
        return value / np.sqrt(np.maximum(slope, 1e-30)) * self._focal_px, ids

    def _costs(self, distances: Array, ids: IntArray) -> Array:
        """Return the capped mean squared distance between each pair of tracks (A, B, F).

        It is inf for pairs with too few common images.
        """
        squares = np.minimum(distances**2, MATCHING.most_px**2)
        known = np.isfinite(squares)
        width = int(ids.max()) + 1
        keys = (self._a.ids[:, None] * width + ids[None])[known]
        values, index = np.unique(keys, return_inverse=True)
        counts = np.bincount(index, minlength=len(values))
        means = np.bincount(index, squares[known], minlength=len(values)) / np.maximum(counts, 1)
        means[counts < MATCHING.fewest_samples] = np.inf
        costs = np.full(distances.shape, np.inf)
        costs[known] = means[index]
        return costs

    def score(self, offset_s: float) -> float:
        """Return the misfit of the tracks at an offset."""
        distances, ids = self._distances(offset_s, 0.0)
        best = self._costs(distances, ids).min(axis=1)
        there = self._a.ids >= 0
        return float(np.minimum(best[there], MATCHING.most_px**2).sum())

    def refine(self, offset_s: float, drift: float) -> TimeOffset:
        """Refine offset and drift with the pairs of tracks that match at them."""
        distances, ids = self._distances(offset_s, drift)
        costs = self._costs(distances, ids)
        chosen = np.isfinite(costs) & (costs == costs.min(axis=1, keepdims=True))
        chosen &= costs == costs.min(axis=0, keepdims=True)
        if not chosen.any():
            return TimeOffset()
        usual = float(np.median(costs[chosen]))
        chosen &= costs <= MATCHING.accepted**2 * max(usual, MATCHING.least_scale_px**2)
        a, b, f = np.nonzero(chosen)
        since = self.times_s[f] - self._middle_s
        # Velocities and distances come from different images. Noise that both shared would bias the offset towards the
        # middle between two images, where interpolated noise is smallest.
        apart_s = MATCHING.difference_frames * float(np.median(np.diff(self._b.times_s)))

        def linearise(state: Array) -> tuple[Array, Array]:
            ahead, here, behind = (
                self._distances(state[0] + step, state[1])[0][a, b, f] for step in (apart_s, 0.0, -apart_s)
            )
            rate = (ahead - behind) / (2.0 * apart_s)
            usable = np.isfinite(rate) & np.isfinite(here)
            residual, rate = np.where(usable, here, 0.0), np.where(usable, rate, 0.0)
            usual_px = float(np.median(np.abs(here[usable]))) if usable.any() else 0.0
            scale = max(1.4826 * usual_px, MATCHING.least_scale_px)
            weights = 1.0 / (scale * np.hypot(1.0, residual / (2.0 * scale)))
            rows = np.stack((weights * rate, weights * rate * since, weights * residual), axis=1)
            prior = (0.0, 1.0 / MATCHING.drift_sigma, state[1] / MATCHING.drift_sigma)
            rows = np.concatenate((rows, [prior]))
            return rows[:, 2], rows[:, :2]

        state, residuals, rows = gauss_newton(
            np.array([offset_s, drift]),
            linearise,
            MATCHING.steps,
            solve=lambda matrix, vector: np.linalg.lstsq(matrix, vector, rcond=None)[0],
        )
        usable = rows[:-1, 0] != 0.0
        if usable.sum() < MATCHING.fewest_samples:
            return TimeOffset()
        # errors of calibration and of overlapping blobs last for some time, so they are summed over blocks
        times = np.floor(self.times_s[f][usable] / MATCHING.block_s).astype(np.int64)
        _, index = np.unique(ids[b, f][usable] * 100_000 + times, return_inverse=True)
        parts = np.zeros((index.max() + 1, 2))
        np.add.at(parts, index, (rows * residuals[:, None])[:-1][usable])
        inverse = np.linalg.pinv(rows.T @ rows)
        covariance = inverse @ (parts.T @ parts) @ inverse
        sigma = float(np.sqrt(max(covariance[0, 0], inverse[0, 0])))
        return TimeOffset(float(state[0]), float(state[1]), self._middle_s, sigma, int(usable.sum()))


def estimate_time_offsets(
    rig: CameraRig, frames: Sequence[MarkerFrame], largest_s: float, about: Sequence[TimeOffset] = ()
) -> tuple[TimeOffset, ...]:
    """Return each camera's time offset relative to the first, estimated from the blobs of marker frames.

    Args:
        frames: Frames with the blobs' positions in the images, and the images' time stamps.
        largest_s: Largest difference from `about`.
        about: Rough estimates of the offsets; zeros by default.
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
