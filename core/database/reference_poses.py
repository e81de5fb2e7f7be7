"""Reference poses: the rest rotations of each recorded subject's hands and thumbs, estimated from the data.

Studios define the rest pose of hands and thumbs differently: a hand that is straight in one file is bent by 40 degrees
in another. Poses are stored relative to the subject's own reference pose, so that equal poses have equal numbers. A
reference pose is the median of the subject's clips, shrunk towards the median of all subjects according to the variance
between clips of one subject (random effects, Laird and Ware 1982), because a subject's clips also differ in what was
performed. With fewer than three subjects, or with one clip per subject, all subjects use the common reference pose.
"""

import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..body.standard_skeleton import JOINT_NAMES
from ..geometry import rotations as rot
from ..geometry.arrays import Array, FloatArray, Mask
from .frame_file import FrameFile
from .header_facts import Clip
from .store import Database, ReferencePose, pose_from_rotations


@dataclass(frozen=True)
class ReferencePoseSettings:
    """Settings for the estimation of reference poses."""

    mean_samples: int = 20_000  # frames used for the mean rotations
    clip_samples: int = 60  # frames of each clip used for its median
    farthest_rad: float = 1.0  # cap on a clip's distance from its subject's median: recordings have flipped joints
    impossible_rad: float = np.radians(100.0)  # rotation above which a limb's end joint is certainly flipped
    median_steps: int = 30  # largest number of steps of Weiszfeld's algorithm
    least_rad: float = 0.01  # smallest distance that the algorithm divides by
    settled_rad: float = 1e-7  # the algorithm stops when the remaining steps cannot move a median by more
    chunk: int = 4096  # frames converted at once
    clips: int = 32  # clips whose medians are computed at once, so that they fit into the CPU's cache


_SETTINGS = ReferencePoseSettings()
_TINY = 1e-12


def _joints(middle: Sequence[str], of_sides: Sequence[str]) -> list[int]:
    return [JOINT_NAMES.index(name) for name in (*middle, *(side + name for side in "lr" for name in of_sides))]


# Feet and head differ as much between clips of one subject as between subjects, so they keep the common reference pose.
_JOINTS = _joints((), ("wrist", "hand", "fingers", "thumb"))
_ENDS = _joints(("upperneck", "head"), ("foot", "toes", "hand", "fingers", "thumb"))

_Person = tuple[str, int, bool]


def relative_poses(
    rotations: NDArray[Any] | FrameFile, clips: Sequence[Clip]
) -> tuple[Array, tuple[ReferencePose, ...], FloatArray]:
    """Return the common reference pose (J, 4), the subjects' own reference poses, and poses (F, J - 1, 3).

    If a subject has its own reference pose, the end joints of its limbs keep their last valid rotation while they are
    flipped in the recording.

    Args:
        rotations: Local rotations (F, J, 4) of the clips' frames.
    """
    common, references = find_reference_poses(rotations, clips)
    own = {_person(reference): reference.rotations for reference in references}
    poses = np.empty((len(rotations), len(JOINT_NAMES) - 1, 3), dtype=np.float32)

    def fill(clip: Clip) -> None:
        for start in range(clip.start, clip.stop, _SETTINGS.chunk):
            part = slice(start, min(start + _SETTINGS.chunk, clip.stop))
            poses[part] = pose_from_rotations(rotations[part], own.get(_person(clip), common))
        if _person(clip) in own:
            _hold_flipped(poses[clip.start : clip.stop])

    with ThreadPoolExecutor(os.cpu_count()) as threads:  # NumPy releases the GIL
        list(threads.map(fill, clips))
    return common, references, poses


def find_reference_poses(
    rotations: NDArray[Any] | FrameFile, clips: Sequence[Clip]
) -> tuple[Array, tuple[ReferencePose, ...]]:
    """Return the common reference pose (J, 4) and those of the subjects."""

    def samples_of(clip: Clip) -> Array:
        chosen = np.linspace(0, clip.stop - clip.start - 1, _SETTINGS.clip_samples).astype(np.int64)
        return rot.normalize(rotations[clip.start : clip.stop][chosen][:, _JOINTS])

    persons: dict[_Person, list[Array]] = {}
    with ThreadPoolExecutor(os.cpu_count()) as threads:
        evenly = threads.submit(lambda: rotations[:: max(1, len(rotations) // _SETTINGS.mean_samples)])
        for clip, samples in zip(clips, threads.map(samples_of, clips), strict=True):
            persons.setdefault(_person(clip), []).append(samples)
        mean = rot.mean(evenly.result())
    if len(persons) < 3 or all(len(parts) == 1 for parts in persons.values()):
        return mean, ()
    with ThreadPoolExecutor(os.cpu_count()) as threads:
        medians = np.array(list(threads.map(_median, map(np.concatenate, persons.values()))))
        several = [np.array(parts) for parts in persons.values() if len(parts) > 1]
        within = np.mean(list(threads.map(_clip_variance, several)), axis=0)
    common = mean.copy()
    common[_JOINTS] = _median(medians)
    away = rot.to_rotation_vector(rot.multiply(rot.conjugate(common[_JOINTS]), medians))
    uncertain = within / np.array([[len(parts)] for parts in persons.values()])
    between = np.maximum(np.sum(away**2, axis=(0, 2)) / (len(away) - 1) - uncertain.mean(axis=0), 0.0)
    shares = (between / (between + uncertain + 1e-12))[:, :, None]
    turned = np.repeat(common[None], len(away), axis=0)
    turned[:, _JOINTS] = rot.multiply(common[_JOINTS], rot.from_rotation_vector(shares * away))
    return common, tuple(ReferencePose(*person, turn) for person, turn in zip(persons, turned, strict=True))


def reference_pose_report(database: Database) -> dict[str, dict[str, float]]:
    """Return, by subject, each joint's angle from the common reference pose, degrees."""
    result = {}
    for reference in database.reference_poses:
        turned = np.degrees(rot.angle_between(reference.rotations, database.mean_rotations))
        if not reference.mirrored:
            result[reference.subject] = {JOINT_NAMES[joint]: round(float(turned[joint]), 1) for joint in _JOINTS}
    return result


def _median(rotations: Array) -> Array:
    """Return the geometric median (J, 4) of rotations (N, J, 4)."""
    return _medians(rotations[:, None])[0]


def _medians(rotations: Array) -> Array:
    """Return the medians (C, J, 4) of unit quaternions (N, C, J, 4) (Weiszfeld 1937)."""
    medians = rot.mean(rotations)
    parts = np.ascontiguousarray(np.moveaxis(rotations, 0, -1))  # shape (C, J, 4, N)
    for left in range(_SETTINGS.median_steps, 0, -1):
        cosines = (medians[..., None, :] @ parts)[..., 0, :]
        nearest = np.minimum(np.abs(cosines), 1.0 - _TINY)
        angles = 2.0 * np.arccos(nearest)
        weights = 1.0 / np.maximum(angles, _SETTINGS.least_rad)
        factors = np.copysign(weights * angles / np.sqrt((1.0 - nearest) * (1.0 + nearest)), cosines)
        # the step towards a rotation is linear in that rotation, so only the sum is made relative to the median
        sums = rot.multiply(rot.conjugate(medians), (parts @ factors[..., None])[..., 0])
        shifts = sums[..., 1:] / np.sum(weights, axis=-1)[..., None]
        medians = rot.multiply(medians, rot.from_rotation_vector(shifts))
        if left * np.max(np.abs(shifts)) < _SETTINGS.settled_rad:
            break
    return np.asarray(medians)


def _clip_variance(clips: Array) -> Array:
    """Return the variance (J,) of a subject's clips (C, N, J, 4) about their median."""
    step = _SETTINGS.clips
    medians = np.concatenate([_medians(clips[i : i + step].swapaxes(0, 1)) for i in range(0, len(clips), step)])
    away = np.minimum(rot.angle_between(_median(medians), medians), _SETTINGS.farthest_rad)
    return np.asarray(np.sum(away**2, axis=0) / (len(clips) - 1))


def _hold_flipped(poses: FloatArray) -> None:
    """Repair flipped hands, feet and head in a clip's poses (F, J - 1, 3), in place."""
    far: Mask = np.einsum("fji,fji->fj", poses, poses) > _SETTINGS.impossible_rad**2
    for joint in _ENDS:
        flipped, vectors = far[:, joint - 1], poses[:, joint - 1]
        if flipped.all():
            vectors[:] = 0.0
        elif flipped.any():
            kept = np.maximum.accumulate(np.where(flipped, -1, np.arange(len(vectors))))
            vectors[:] = vectors[np.where(kept < 0, np.argmin(flipped), kept)]


def _person(of: Clip | ReferencePose) -> _Person:
    return of.subject, of.skeleton, of.mirrored
