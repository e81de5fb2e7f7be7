"""Motion of a database on the body of a character, ready to be searched.

Points on the floor are complex numbers, z + i x: to turn by a yaw about the vertical is to multiply by exp(i yaw).
"""

from collections.abc import Sequence
from fnmatch import fnmatch

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter, minimum_filter1d

from ..body.calibration_poses import hanging
from ..body.posed_markers import markers_at_rest
from ..body.skeleton import Skeleton, forward_kinematics
from ..database.store import Clip, Database, check_arrays
from ..errors import SettingsError
from ..geometry import rotations as rot
from ..geometry.arrays import Array, FloatArray, IntArray, Mask

Planar = NDArray[np.complex64]

BODY = (
    "root", "thorax", "head",
    *(side + name for side in "lr" for name in ("humerus", "radius", "hand", "femur", "tibia", "foot", "toes")),
)  # fmt: skip
TOES = ("ltoes", "rtoes")
_SEARCH_FPS = 30.0  # of the frames at which a stretch may begin
_LOWEST_PERCENT = 5.0  # of a clip's frames, taken as its floor: single frames are noise
_STANDING_M, _STANDING_M_S = 0.05, 0.35  # a standing foot is lower above that floor, and slower
_STILL_M, _STILL_M_S = 0.05, 0.25  # still toes are lower above their lowest place within a second, and slower
_STEADY_S = 0.1  # contact changes no faster
_CHUNK = 1 << 15  # frames computed at once


class MotionLibrary:
    """Clips of a database as motion of one skeleton.

    Args:
        skeleton: standard skeleton of the character; roots' paths are scaled to its legs.
        joints: more joints to place than those of `BODY`.
        behaviours: patterns of the behaviours or names of clips to draw from, all if empty.

    Raises:
        SettingsError: no clip has such a behaviour.
        DatabaseError: the database is damaged.
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
        # joint by joint in memory, as they are searched
        self.planar: Planar = np.empty(local_m.shape[:2], dtype=np.complex64, order="F")
        self.heights_m: FloatArray = np.empty(local_m.shape[:2], dtype=np.float32, order="F")
        for first in range(0, database.frames, _CHUNK):
            frames = slice(first, first + _CHUNK)
            world_m = rot.rotate(
                np.asarray(database.root_rotations[frames], dtype=np.float64)[:, None], local_m[frames]
            )
            world_m += self.root_positions_m(np.arange(database.frames)[frames])[:, None]
            self.planar[frames] = world_m[..., 2] + 1j * world_m[..., 0]
            self.heights_m[frames] = world_m[..., 1]
        self._level(skeleton)
        self.contacts, self.still_toes = self._contacts()
        heights_m = forward_kinematics(skeleton, hanging(skeleton), np.zeros(3))[0][:, 1]
        self.hanging_m = float(np.mean([heights_m[skeleton.index(side + "hand")] for side in "lr"]))  # above the root

    def _level(self, skeleton: Skeleton) -> None:
        """Put the floor of each clip at y = 0."""
        toes = [self.columns[name] for name in TOES]
        for index, clip in enumerate(self.database.clips):
            part = slice(clip.start, clip.stop)
            lowest = float(np.percentile(self.heights_m[part, toes].min(axis=1), _LOWEST_PERCENT))
            self._floors_m[index] = lowest - standing_toes_m(skeleton)
            self.heights_m[part] -= self._floors_m[index]

    def _contacts(self) -> tuple[Mask, Mask]:
        """Return (F, 2) whether left and right toes stand, and (F, 2) if they are still."""
        toes = [self.columns[name] for name in TOES]
        result, still = np.zeros((2, self.database.frames, 2), dtype=np.bool_)
        size, second = 2 * round(_STEADY_S * self.fps / 2) + 1, 2 * round(self.fps) + 1
        for clip in self.database.clips:
            part = slice(clip.start, clip.stop)
            places, heights = self.planar[part][:, toes], self.heights_m[part][:, toes]
            if len(places) < 2:
                result[part] = still[part] = True
                continue
            speeds = np.abs(np.gradient(places.astype(np.complex128), axis=0)) * self.fps
            low = heights - np.percentile(heights, _LOWEST_PERCENT, axis=0) < _STANDING_M
            result[part] = median_filter(low & (speeds < _STANDING_M_S), size=(size, 1), mode="nearest")
            low = heights - minimum_filter1d(heights, second, axis=0, mode="nearest") < _STILL_M
            still[part] = low & (np.hypot(speeds, np.gradient(heights, axis=0) * self.fps) < _STILL_M_S)
        return result, still

    def clip_of(self, frame: float) -> Clip:
        """Return the clip of a frame."""
        return self.database.clips[int(self.database.clip_of_frame[int(frame)])]

    def starts(self, first: int, last: int) -> IntArray:
        """Return the frames of windows, each within one clip.

        Args:
            first, last: frames of a window, relative to the returned one.
        """
        step = max(1, round(self.fps / _SEARCH_FPS))
        found = [
            np.arange(clip.start - min(first, 0), clip.stop - max(last, 0), step)
            for clip, usable in zip(self.database.clips, self._usable, strict=True)
            if usable
        ]
        return np.concatenate(found) if found else np.zeros(0, dtype=np.int64)

    def root_positions_m(self, frames: IntArray) -> Array:
        """Return root positions (N, 3) of the character in frames (N,)."""
        clips = self.database.clip_of_frame[frames]
        positions = self._scales[clips][:, None] * np.asarray(self.database.root_positions_m[frames], dtype=np.float64)
        positions[:, 1] -= self._floors_m[clips]
        return np.asarray(positions)

    def poses_at(self, frames: Array) -> tuple[Array, Array, Array]:
        """Return poses (N, 28, 3), root rotations (N, 4) and places (N, 3).

        Args:
            frames: (N,), need not be whole; none is after its clip's last.
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
    """Return about how high the toes' joints of a standing body are, in metres."""
    return 0.024 * _leg_m(skeleton) / 0.8


def _usable_clips(database: Database, behaviours: Sequence[str]) -> Mask:
    """Return the mask (C,) of clips that fit a pattern."""
    fits = [
        not behaviours or any(fnmatch(text.lower(), p.lower()) for p in behaviours for text in (c.behaviour, c.name))
        for c in database.clips
    ]
    if not any(fits):
        names = sorted({clip.behaviour for clip in database.clips})
        listed = ", ".join(names[:20]) + (", ..." if len(names) > 20 else "")
        raise SettingsError(f"no clip has a behaviour {', '.join(behaviours)}", advice=f"behaviours: {listed}")
    return np.array(fits)


def _leg_m(skeleton: Skeleton) -> float:
    """Return the length of a leg from hip to ankle."""
    lengths = np.linalg.norm(skeleton.offsets_m, axis=1)
    return float(sum(lengths[skeleton.index(side + name)] for side in "lr" for name in ("tibia", "foot")) / 2.0)
