"""Culling near-duplicates: passages that an earlier clip of a database already contains.

A frame is a near-duplicate if its pose and the pose `ahead_s` later are both close to those of a frame kept from an
earlier clip; the later pose tells directions of motion apart. Short passages are kept, and so are margins around new
motion, so that velocities can be computed there. Each frame is compared only with its nearest few in
principal-component space; duplicates that this misses are kept.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..body.joint_angle_frames import angle_frame
from ..body.standard_skeleton import JOINT_NAMES
from ..geometry.arrays import FloatArray, IntArray, Mask, runs
from .header_facts import Clip

JOINT_ANGLES = sum(len(angle_frame(name)[1]) for name in JOINT_NAMES[1:])


@dataclass(frozen=True)
class CullSettings:
    """Settings for comparing passages and searching for candidates."""

    distance_deg: float = 1.0  # recommended distance, see `near_duplicates`
    ahead_s: float = 0.1  # time to the second pose that is compared
    shortest_s: float = 0.25  # shortest passage that is left out
    margin_s: float = 0.1  # time kept on both sides of new motion
    compared_per_s: float = 20.0  # frames compared per second; each decides for the frames up to the next one
    components: int = 12  # number of principal components
    candidates: int = 4  # nearest frames in principal-component space that are compared
    samples: int = 20_000  # frames used to compute the components
    tree: int = 4096  # fewest frames for which a search tree is faster than comparing with all of them


SETTINGS = CullSettings()


def near_duplicates(poses: FloatArray, clips: Sequence[Clip], fps: float, distance_deg: float) -> Mask:
    """Return a mask (F,) of the frames that can be left out.

    Args:
        poses: Rotation vectors (F, D) of the joints, radians.
        clips: Clips that cover the frames in order; earlier clips are kept.
        distance_deg: RMS difference of the joint angles below which two poses count as equal, degrees.
    """
    duplicate = np.zeros(len(poses), dtype=np.bool_)
    from scipy.ndimage import binary_erosion, binary_opening  # live capture, which opens databases, does without SciPy

    stride = max(1, round(fps / SETTINGS.compared_per_s))
    ahead, margin = round(SETTINGS.ahead_s * fps), round(SETTINGS.margin_s * fps)
    shortest = max(1, math.ceil(SETTINGS.shortest_s * fps))
    kept = _Kept(poses, ahead, np.radians(distance_deg) * np.sqrt(2.0 * JOINT_ANGLES))
    for clip in clips:
        frames = np.arange(clip.start, clip.stop - ahead, stride)
        if len(frames) == 0:
            continue
        features = kept.features(frames)
        known = np.zeros(clip.stop - clip.start, dtype=np.bool_)
        known[: len(frames) * stride] = np.repeat(kept.holds(features), stride)[: len(known)]
        # the last frames have no later pose, so the last compared frame decides for them
        known[len(frames) * stride :] = known[len(frames) * stride - 1]
        culled = binary_erosion(known, np.ones(2 * margin + 1), border_value=1)
        culled = binary_opening(culled, np.ones(shortest))  # shorter passages are kept
        duplicate[clip.start : clip.stop] = culled
        kept.add(features[~culled[frames - clip.start]])
    return duplicate


class _Kept:
    """Frames kept so far, in search trees of doubling size."""

    def __init__(self, poses: FloatArray, ahead: int, radius: float) -> None:
        self._poses = poses
        self._ahead = ahead
        self._radius = radius
        sample = poses[:: max(1, len(poses) // SETTINGS.samples)].astype(np.float64)
        self._middle = sample.mean(axis=0).astype(np.float32)
        _, _, axes = np.linalg.svd(sample - self._middle, full_matrices=False)
        self._axes = axes[: SETTINGS.components].T.astype(np.float32)
        self._parts: list[tuple[Any, FloatArray]] = []

    def features(self, frames: IntArray) -> FloatArray:
        """Return each frame's pose, joined with the pose `ahead_s` later (n, 2 D)."""
        return np.concatenate((self._poses[frames], self._poses[frames + self._ahead]), axis=1)

    def _components(self, features: FloatArray) -> FloatArray:
        halves = features.reshape(len(features), 2, -1) - self._middle
        return (halves @ self._axes).reshape(len(features), -1)

    def holds(self, features: FloatArray) -> Mask:
        """Return a mask (n,) of the features within the radius of a kept frame's features."""
        result = np.zeros(len(features), dtype=np.bool_)
        components = self._components(features)
        for tree, points in self._parts:
            open_rows = np.flatnonzero(~result)
            if tree is None:
                mine, theirs = features[open_rows], points
                squared = np.sum(mine**2, axis=1)[:, None] - 2.0 * (mine @ theirs.T) + np.sum(theirs**2, axis=1)
                result[open_rows] = np.any(squared < self._radius**2, axis=1)
                continue
            _, found = tree.query(components[open_rows], k=SETTINGS.candidates, distance_upper_bound=self._radius)
            candidates = np.minimum(found, len(points) - 1)
            apart = np.linalg.norm(points[candidates] - features[open_rows][:, None], axis=-1)
            result[open_rows] = np.any((found < len(points)) & (apart < self._radius), axis=1)
        return result

    def add(self, features: FloatArray) -> None:
        from scipy.spatial import cKDTree

        if len(features) == 0:
            return
        # merging with trees that are no larger keeps the number of trees small
        while self._parts and len(self._parts[-1][1]) <= len(features):
            features = np.concatenate((self._parts.pop()[1], features))
        tree = cKDTree(self._components(features)) if len(features) >= SETTINGS.tree else None
        self._parts.append((tree, features))


def clips_after_culling(clips: Sequence[Clip], culled: Mask, fps: float) -> list[Clip]:
    """Return the clips made of the remaining frames, with their new frame ranges."""
    kept: list[Clip] = []
    for clip in clips:
        for first, stop in runs(~culled[clip.start : clip.stop]):
            kept.append(clip.part(first, stop, kept[-1].stop if kept else 0, fps))
    return kept
