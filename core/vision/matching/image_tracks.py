"""Tracking one camera's blobs from image to image."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...geometry.arrays import Array, IntArray, Mask
from ...geometry.gated_assignment import assign
from ...geometry.rotations import lengths
from .matching_settings import MATCHING


class BlobLinker:
    """Linker of blobs to tracks; a track ends after a gap."""

    def __init__(self, width_px: int) -> None:
        self._scale = width_px / 640.0
        self._next = 0
        self._tracks = np.empty((0, 5))  # x, y, their velocities (NaN while unknown), time last seen
        self._ids = np.empty(0, dtype=np.int64)

    def link(self, time_s: float, pixels: Array) -> IntArray:
        """Return the track (n,) of each blob (n, 2) of the next image; times must increase."""
        self._keep(time_s - self._tracks[:, 4] <= MATCHING.longest_gap_s)
        ids = np.full(len(pixels), -1, dtype=np.int64)
        seen = np.full((len(pixels), 5), np.nan)
        seen[:, :2], seen[:, 4] = pixels, time_s
        if len(self._ids) and len(pixels):
            passed_s = time_s - self._tracks[:, 4:]
            velocities = self._tracks[:, 2:4]
            known = np.isfinite(velocities)
            speeds = np.where(known[:, :1], MATCHING.gate_px_s, MATCHING.new_px_s)
            gates = self._scale * (MATCHING.gate_px + speeds * passed_s)
            expected = self._tracks[:, :2] + np.where(known, velocities, 0.0) * passed_s
            rows, columns = assign(lengths(expected[:, None] - pixels) / gates)
            ids[columns] = self._ids[rows]
            seen[columns, 2:4] = (pixels[columns] - self._tracks[rows, :2]) / passed_s[rows]
            unseen = np.ones(len(self._ids), dtype=bool)
            unseen[rows] = False
            self._keep(unseen)
        new = (ids < 0).nonzero()[0]
        ids[new] = self._next + np.arange(len(new))
        self._next += len(new)
        self._tracks = np.concatenate((seen, self._tracks))
        self._ids = np.concatenate((ids, self._ids))
        return ids

    def _keep(self, kept: Mask) -> None:
        if not kept.all():
            self._tracks, self._ids = self._tracks[kept], self._ids[kept]


@dataclass(frozen=True)
class ImageTracks:
    """Tracks of one camera in a table; each row can hold several tracks, one after the other."""

    times_s: Array  # (F,) of the images, increasing
    points: Array  # (S, F, 2) undistorted normalised coordinates, NaN where a row has no track
    ids: IntArray  # (S, F), -1 where a row has no track

    def thin(self, most: int) -> "ImageTracks":
        """Return the tracks in at most this many evenly spaced images."""
        step = -(-len(self.times_s) // most)
        return ImageTracks(self.times_s[::step], self.points[:, ::step], self.ids[:, ::step])

    def at(self, times_s: Array) -> tuple[Array, IntArray]:
        """Return points (S, N, 2) and tracks (S, N) at other times, NaN and -1 outside.

        Points are interpolated by cubics from two images before and two after, all of which must show the track.
        """
        last = len(self.times_s) - 3
        if last < 1:
            return np.full((len(self.points), len(times_s), 2), np.nan), np.full((len(self.points), len(times_s)), -1)
        place = np.searchsorted(self.times_s, times_s, side="right") - 1
        inside = (place >= 1) & (place <= last)
        place = np.clip(place, 1, last)
        t0, t1, t2, t3 = (self.times_s[place + k] for k in (-1, 0, 1, 2))
        p0, p1, p2, p3 = (self.points[:, place + k] for k in (-1, 0, 1, 2))
        ids = self.ids[:, place]
        whole = inside & (ids >= 0)
        for k in (-1, 1, 2):
            whole &= self.ids[:, place + k] == ids
        span = t2 - t1
        f = ((times_s - t1) / span)[:, None]
        slope1, slope2 = (p2 - p0) * (span / (t2 - t0))[:, None], (p3 - p1) * (span / (t3 - t1))[:, None]
        f2, f3 = f * f, f * f * f
        points = (2 * f3 - 3 * f2 + 1) * p1 + (f3 - 2 * f2 + f) * slope1
        points = points + (3 * f2 - 2 * f3) * p2 + (f3 - f2) * slope2
        return np.where(whole[..., None], points, np.nan), np.where(whole, ids, -1)


def image_tracks(times_s: Sequence[float], points: Sequence[Array], ids: Sequence[IntArray]) -> ImageTracks:
    """Return a table of tracks from the points (n, 2) and tracks (n,) of each image."""
    rows: list[int] = []  # first free frame after each row's last track
    row_of: dict[int, int] = {}
    last = {int(track): f for f, tracks in enumerate(ids) for track in tracks}
    for f, tracks in enumerate(ids):
        for track in tracks.tolist():
            if track in row_of:
                continue
            row = next((r for r, free in enumerate(rows) if free <= f), len(rows))
            rows[row : row + 1] = [last[track] + 1]
            row_of[track] = row
    table = np.full((len(rows), len(ids), 2), np.nan)
    numbers = np.full((len(rows), len(ids)), -1, dtype=np.int64)
    for f, (tracks, seen) in enumerate(zip(ids, points, strict=True)):
        where = [row_of[track] for track in tracks.tolist()]
        table[where, f], numbers[where, f] = seen, tracks
    return ImageTracks(np.asarray(times_s, dtype=np.float64), table, numbers)
