"""Culling near-duplicates: passages that an earlier clip of a database already contains.

A frame is a near-duplicate if its pose and the pose `ahead_s` later are both close to those of a frame kept from an
earlier clip; the later pose tells directions of motion apart. Short passages are kept, and so are margins around new
motion, so that velocities can be computed there.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

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
    samples: int = 20_000  # frames used to compute the first principal component
    together: int = 64  # frames compared at once


SETTINGS = CullSettings()


def near_duplicates(poses: FloatArray, clips: Sequence[Clip], fps: float, distance_deg: float) -> Mask:
    """Return a mask (F,) of the frames that can be left out.

    Args:
        poses: Rotation vectors (F, D) of the joints, radians.
        clips: Clips that cover the frames in order; earlier clips are kept.
        distance_deg: RMS difference of the joint angles below which two poses count as equal, degrees.
    """
    duplicate = np.zeros(len(poses), dtype=np.bool_)
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
        for start, stop in runs(known):
            first = clip.start + (start + margin if start > 0 else 0)
            last = clip.start + (stop - margin if stop < len(known) else stop)
            duplicate[first:last] = last - first >= shortest
        kept.add(features[~duplicate[frames]])
    return duplicate


@dataclass(frozen=True)
class _Part:
    """Frames in the order of their place along an axis."""

    places: FloatArray  # (n,)
    features: FloatArray  # (n, 2 D)
    squares: FloatArray  # (n,) squared lengths of the features


class _Kept:
    """Frames kept so far, in parts of doubling size.

    Frames nearer than the radius are nearer along each axis, too. Only those are compared, along the first principal
    axis of the poses.
    """

    def __init__(self, poses: FloatArray, ahead: int, radius: float) -> None:
        self._poses = poses
        self._ahead = ahead
        self._radius = radius
        sample = poses[:: max(1, len(poses) // SETTINGS.samples)].astype(np.float64)
        _, _, axes = np.linalg.svd(sample - sample.mean(axis=0), full_matrices=False)
        self._axis = (np.tile(axes[0], 2) / np.sqrt(2.0)).astype(np.float32)
        self._parts: list[_Part] = []

    def features(self, frames: IntArray) -> FloatArray:
        """Return each frame's pose, joined with the pose `ahead_s` later (n, 2 D)."""
        return np.concatenate((self._poses[frames], self._poses[frames + self._ahead]), axis=1)

    def _part(self, features: FloatArray) -> _Part:
        places = features @ self._axis
        order = np.argsort(places)
        ordered = features[order]
        return _Part(places[order], ordered, np.sum(ordered**2, axis=1))

    def holds(self, features: FloatArray) -> Mask:
        """Return a mask (n,) of the features within the radius of a kept frame's features."""
        result = np.zeros(len(features), dtype=np.bool_)
        places = features @ self._axis
        order = np.argsort(places)
        for part in self._parts:
            open_rows = order[~result[order]]
            for first in range(0, len(open_rows), SETTINGS.together):
                rows = open_rows[first : first + SETTINGS.together]
                result[rows] = self._near(features[rows], places[rows], part)
        return result

    def _near(self, features: FloatArray, places: FloatArray, part: _Part) -> Mask:
        """Return a mask (n,) of the features (n, 2 D), in the order of their places, near any of a part."""
        edges = np.array([places[0] - self._radius, places[-1] + self._radius], dtype=np.float32)
        near = slice(*np.searchsorted(part.places, edges))
        products = features @ part.features[near].T
        squared = np.sum(features**2, axis=1)[:, None] - 2.0 * products + part.squares[near]
        return np.any(squared < self._radius**2, axis=1)

    def add(self, features: FloatArray) -> None:
        if len(features) == 0:
            return
        # merging with parts that are no larger keeps their number small
        while self._parts and len(self._parts[-1].features) <= len(features):
            features = np.concatenate((self._parts.pop().features, features))
        self._parts.append(self._part(features))


def clips_after_culling(clips: Sequence[Clip], culled: Mask, fps: float) -> list[Clip]:
    """Return the clips made of the remaining frames, with their new frame ranges."""
    kept: list[Clip] = []
    for clip in clips:
        for first, stop in runs(~culled[clip.start : clip.stop]):
            kept.append(clip.part(first, stop, kept[-1].stop if kept else 0, fps))
    return kept
