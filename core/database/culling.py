"""Near-duplicates: passages that an earlier clip of a database already holds.

A frame is a near-duplicate when its pose and the one `_LOOK_AHEAD_S` later, together the motion and its direction, lie
within a distance of those of one frame kept from an earlier clip. Only passages go: one shorter than
`_SHORTEST_CULLED_S` stays, and so do `_MARGIN_S` on either side of new motion, so that it has velocities. Frames are
compared with few candidates, the nearest by the strongest principal components; a duplicate missed that way stays.
"""

from collections.abc import Sequence

import numpy as np
from scipy.spatial import cKDTree

from ..body.joint_angle_frames import angle_frame
from ..body.standard_skeleton import JOINT_NAMES
from ..geometry.arrays import FloatArray, IntArray, Mask, runs
from .store import Clip

DEFAULT_CULL_DEG = 1.0
JOINT_ANGLES = sum(len(angle_frame(name)[1]) for name in JOINT_NAMES[1:])

_LOOK_AHEAD_S = 0.1
_SHORTEST_CULLED_S = 0.25
_MARGIN_S = 0.1
_COMPARED_PER_S = 20.0  # frames that are looked at; those between follow them
_COMPONENTS = 12
_CANDIDATES = 4
_SAMPLES = 20_000  # frames that the components are taken from
_TREE = 4096  # frames that are gathered before they get a search tree


def near_duplicates(poses: FloatArray, clips: Sequence[Clip], fps: float, distance_deg: float) -> Mask:
    """Return (F,) true for the frames that may go.

    Args:
        poses: (F, D) rotation vectors of the joints, radians.
        clips: cover the frames in order; earlier ones are kept.
        distance_deg: root mean square over the joint angles below which two poses count as one, degrees.
    """
    duplicate = np.zeros(len(poses), dtype=np.bool_)
    stride = max(1, round(fps / _COMPARED_PER_S))
    ahead, margin = round(_LOOK_AHEAD_S * fps), round(_MARGIN_S * fps)
    kept = _Kept(poses, ahead, np.radians(distance_deg) * np.sqrt(2.0 * JOINT_ANGLES))
    for clip in clips:
        frames = np.arange(clip.start, clip.stop - ahead, stride)
        if len(frames) == 0:
            continue
        features = kept.features(frames)
        known = np.zeros(clip.stop - clip.start, dtype=np.bool_)
        known[: len(frames) * stride] = np.repeat(kept.holds(features), stride)[: len(known)]
        known[len(frames) * stride :] = known[len(frames) * stride - 1]  # the last look ahead covers the end
        culled = _long_runs(_shrunk(known, margin), _SHORTEST_CULLED_S * fps)
        duplicate[clip.start : clip.stop] = culled
        kept.add(features[~culled[frames - clip.start]])
    return duplicate


class _Kept:
    """The frames kept so far, in search trees of doubling size."""

    def __init__(self, poses: FloatArray, ahead: int, radius: float) -> None:
        self._poses = poses
        self._ahead = ahead
        self._radius = radius
        sample = poses[:: max(1, len(poses) // _SAMPLES)].astype(np.float64)
        self._middle = sample.mean(axis=0).astype(np.float32)
        _, _, axes = np.linalg.svd(sample - self._middle, full_matrices=False)
        self._axes = axes[:_COMPONENTS].T.astype(np.float32)
        self._parts: list[tuple[cKDTree | None, FloatArray]] = []

    def features(self, frames: IntArray) -> FloatArray:
        """Return (n, 2 D): each frame's pose and the later one."""
        return np.concatenate((self._poses[frames], self._poses[frames + self._ahead]), axis=1)

    def _components(self, features: FloatArray) -> FloatArray:
        halves = features.reshape(len(features), 2, -1) - self._middle
        return (halves @ self._axes).reshape(len(features), -1)

    def holds(self, features: FloatArray) -> Mask:
        """Return (n,) whether a kept frame lies within the radius."""
        result = np.zeros(len(features), dtype=np.bool_)
        components = self._components(features)
        for tree, points in self._parts:
            open_rows = np.flatnonzero(~result)
            if tree is None:
                mine, theirs = features[open_rows], points
                squared = np.sum(mine**2, axis=1)[:, None] - 2.0 * (mine @ theirs.T) + np.sum(theirs**2, axis=1)
                result[open_rows] = np.any(squared < self._radius**2, axis=1)
                continue
            _, found = tree.query(components[open_rows], k=_CANDIDATES, distance_upper_bound=self._radius)
            candidates = np.minimum(found, len(points) - 1)
            apart = np.linalg.norm(points[candidates] - features[open_rows][:, None], axis=-1)
            result[open_rows] = np.any((found < len(points)) & (apart < self._radius), axis=1)
        return result

    def add(self, features: FloatArray) -> None:
        if len(features) == 0:
            return
        # like the digits of a counter: a part joins the one before it once it has grown as large
        while self._parts and len(self._parts[-1][1]) <= len(features):
            features = np.concatenate((self._parts.pop()[1], features))
        tree = cKDTree(self._components(features)) if len(features) >= _TREE else None
        self._parts.append((tree, features))


def _shrunk(flags: Mask, by: int) -> Mask:
    """Return the flags without those within `by` frames of one that is not set."""
    unset = np.concatenate(([0], np.cumsum(~flags)))
    places = np.arange(len(flags))
    first, stop = np.maximum(places - by, 0), np.minimum(places + by + 1, len(flags))
    return np.asarray(unset[stop] == unset[first])


def _long_runs(flags: Mask, shortest: float) -> Mask:
    """Return the flags without the runs that are shorter."""
    result = flags.copy()
    for start, stop in runs(flags):
        if stop - start < shortest:
            result[start:stop] = False
    return result


def clips_after_culling(clips: Sequence[Clip], culled: Mask, fps: float) -> list[Clip]:
    """Return the clips of the remaining frames, renumbered."""
    kept: list[Clip] = []
    for clip in clips:
        for first, stop in runs(~culled[clip.start : clip.stop]):
            kept.append(clip.part(first, stop, kept[-1].stop if kept else 0, fps))
    return kept
