"""Motion of a database on a character's body, prepared for the search.

Positions on the floor are complex numbers z + i x, so a rotation about the vertical is a product with exp(i yaw).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fnmatch import fnmatch

import numpy as np
from numpy.typing import NDArray

from ..body.calibration_poses import hanging
from ..body.posed_markers import markers_at_rest
from ..body.skeleton import Skeleton, forward_kinematics
from ..body.window_filters import smallest, usual
from ..database.header_facts import Clip
from ..database.store import Database, check_arrays
from ..errors import SettingsError
from ..geometry import rotations as rot
from ..geometry.arrays import Array, FloatArray, IntArray, Mask

Planar = NDArray[np.complex64]

BODY = (
    "root", "thorax", "head",
    *(side + name for side in "lr" for name in ("humerus", "radius", "hand", "femur", "tibia", "foot", "toes")),
)  # fmt: skip
TOES = ("ltoes", "rtoes")


@dataclass(frozen=True)
class LibrarySettings:
    """Settings for windows and contacts in the database's motion."""

    search_fps: float = 30.0  # rate of the frames at which a window may start
    lowest_percent: float = 5.0  # percentile of a clip's heights that counts as floor: single frames are noisy
    low_m: float = 0.05  # largest height of planted toes above that floor, of still toes above their lowest nearby
    standing_m_s: float = 0.35  # largest horizontal speed of planted toes
    still_m_s: float = 0.25  # largest speed of still toes
    steady_s: float = 0.1  # shortest contact
    chunk: int = 1 << 15  # frames computed at once


SETTINGS = LibrarySettings()


class MotionLibrary:
    """Clips of a database as motion of one skeleton.

    Args:
        skeleton: Standard skeleton of the character; root positions are scaled to its legs.
        joints: Joints to locate in addition to `BODY`.
        behaviours: Patterns of behaviours or names of the clips to draw from; empty for all.

    Raises:
        SettingsError: No clip matches any of the patterns.
        DatabaseError: The database is damaged.
    """

    def __init__(
        self, skeleton: Skeleton, database: Database, joints: Sequence[str] = (), behaviours: Sequence[str] = ()
    ) -> None:
        check_arrays(database)
        self.database = database
        self.fps = database.fps
        self.joints = tuple(dict.fromkeys((*BODY, *joints)))
        self.columns = {name: column for column, name in enumerate(self.joints)}
        self._usable = _usable_clips(database, behaviours)
        indices = np.array([skeleton.index(name) for name in self.joints])
        self._scales = np.array([_leg_m(skeleton) / _leg_m(database.skeletons[c.skeleton]) for c in database.clips])
        self._floors_m = np.zeros(len(database.clips))
        reference = database.reference_pose_of(skeleton)
        local_m = markers_at_rest(skeleton, indices, np.zeros((len(indices), 3)), reference, database.poses)
        # stored joint by joint, in the order of the search
        self.planar: Planar = np.empty(local_m.shape[:2], dtype=np.complex64, order="F")
        self.heights_m: FloatArray = np.empty(local_m.shape[:2], dtype=np.float32, order="F")
        for first in range(0, database.frames, SETTINGS.chunk):
            frames = slice(first, first + SETTINGS.chunk)
            world_m = rot.rotate(
                np.asarray(database.root_rotations[frames], dtype=np.float64)[:, None], local_m[frames]
            )
            world_m += self.root_positions_m(np.arange(database.frames)[frames])[:, None]
            self.planar[frames] = world_m[..., 2] + 1j * world_m[..., 0]
            self.heights_m[frames] = world_m[..., 1]
        self._level(skeleton)
        self.contacts, self.still_toes = self._contacts()
        heights_m = forward_kinematics(skeleton, hanging(skeleton), np.zeros(3))[0][:, 1]
        # relative to the root
        self.hanging_m = float(np.mean([heights_m[skeleton.index(side + "hand")] for side in "lr"]))

    def _level(self, skeleton: Skeleton) -> None:
        """Move the floor of each clip to y = 0."""
        toes = [self.columns[name] for name in TOES]
        for index, clip in enumerate(self.database.clips):
            part = slice(clip.start, clip.stop)
            lowest = float(np.percentile(self.heights_m[part, toes].min(axis=1), SETTINGS.lowest_percent))
            self._floors_m[index] = lowest - standing_toes_m(skeleton)
            self.heights_m[part] -= self._floors_m[index]

    def _contacts(self) -> tuple[Mask, Mask]:
        """Return masks (F, 2) of the frames with planted toes, left and right, and of those with still toes."""
        toes = [self.columns[name] for name in TOES]
        result, still = np.zeros((2, self.database.frames, 2), dtype=np.bool_)
        steady, second = round(SETTINGS.steady_s * self.fps / 2), round(self.fps)
        for clip in self.database.clips:
            part = slice(clip.start, clip.stop)
            places, heights = self.planar[part][:, toes], self.heights_m[part][:, toes]
            if len(places) < 2:
                result[part] = still[part] = True
                continue
            speeds = np.abs(np.gradient(places.astype(np.complex128), axis=0)) * self.fps
            low = heights - np.percentile(heights, SETTINGS.lowest_percent, axis=0) < SETTINGS.low_m
            result[part] = usual(low & (speeds < SETTINGS.standing_m_s), steady)
            low = heights - smallest(heights, second) < SETTINGS.low_m
            speeds = np.hypot(speeds, np.gradient(heights, axis=0) * self.fps)
            still[part] = low & (speeds < SETTINGS.still_m_s)
        return result, still

    def clip_of(self, frame: float) -> Clip:
        """Return the clip that contains a frame."""
        return self.database.clips[int(self.database.clip_of_frame[int(frame)])]

    def starts(self, first: int, last: int) -> IntArray:
        """Return the frames at which windows lie within a single clip.

        Args:
            first: First frame of a window, relative to the returned frame.
            last: Last frame of a window, relative to the returned frame.
        """
        step = max(1, round(self.fps / SETTINGS.search_fps))
        found = [
            np.arange(clip.start - min(first, 0), clip.stop - max(last, 0), step)
            for clip, usable in zip(self.database.clips, self._usable, strict=True)
            if usable
        ]
        return np.concatenate(found) if found else np.zeros(0, dtype=np.int64)

    def root_positions_m(self, frames: IntArray) -> Array:
        """Return the character's root positions (N, 3) in frames (N,)."""
        clips = self.database.clip_of_frame[frames]
        positions = self._scales[clips][:, None] * np.asarray(self.database.root_positions_m[frames], dtype=np.float64)
        positions[:, 1] -= self._floors_m[clips]
        return np.asarray(positions)

    def poses_at(self, frames: Array) -> tuple[Array, Array, Array]:
        """Return poses (N, 28, 3), root rotations (N, 4) and root positions (N, 3).

        Args:
            frames: Fractional frames (N,), none after the last frame of its clip.
        """
        before = np.floor(frames + 1e-9).astype(np.int64)
        after = np.minimum(before + 1, self.database.frames - 1)
        share = np.clip(frames - before, 0.0, 1.0)
        after = np.where(share > 1e-6, after, before)
        poses = [np.asarray(self.database.poses[at], dtype=np.float64) for at in (before, after)]
        turns = [np.asarray(self.database.root_rotations[at], dtype=np.float64) for at in (before, after)]
        places = [self.root_positions_m(at) for at in (before, after)]
        return (
            poses[0] + share[:, None, None] * (poses[1] - poses[0]),
            rot.slerp(turns[0], turns[1], share),
            places[0] + share[:, None] * (places[1] - places[0]),
        )


def standing_toes_m(skeleton: Skeleton) -> float:
    """Return the height of a standing body's toe joints above the floor, metres."""
    return 0.024 * _leg_m(skeleton) / 0.8


def _usable_clips(database: Database, behaviours: Sequence[str]) -> Mask:
    """Return a mask (C,) of the clips that match a pattern."""
    fits = [
        not behaviours or any(fnmatch(text.lower(), p.lower()) for p in behaviours for text in (c.behaviour, c.name))
        for c in database.clips
    ]
    if not any(fits):
        names = sorted({clip.behaviour for clip in database.clips})
        listed = ", ".join(names[:20]) + (", ..." if len(names) > 20 else "")
        raise SettingsError(f"no clip has the behaviour {' or '.join(behaviours)}", advice=f"choose from {listed}")
    return np.array(fits)


def _leg_m(skeleton: Skeleton) -> float:
    """Return the length of a leg from hip to ankle."""
    lengths = np.linalg.norm(skeleton.offsets_m, axis=1)
    return float(sum(lengths[skeleton.index(side + name)] for side in "lr" for name in ("tibia", "foot")) / 2.0)
