"""Labelled marker trajectories: tracked, simulated, or from other systems."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..body.motion import MOST_FPS
from ..errors import TakeError, counted, printable
from ..geometry.arrays import Array, IntArray, Mask
from ..geometry.camera import Camera, CameraRig
from ..geometry.npz import read_arrays, write_arrays
from ..system.files import reading

_KIND = "perfanim marker take"
_VERSION = 1


@dataclass(frozen=True)
class SingleViews:
    """Markers seen by only one camera: rays without positions."""

    rig: CameraRig  # cameras in the take's world
    cameras: IntArray  # (F, M) camera that alone shows a marker, else -1
    points: Array  # (F, M, 2) undistorted normalised coordinates in that camera, NaN elsewhere

    def select(
        self, frames: slice | IntArray = slice(None), markers: Sequence[int] | slice = slice(None)
    ) -> "SingleViews":
        """Return the given frames and markers, in the given order."""
        return SingleViews(self.rig, self.cameras[frames][:, markers], self.points[frames][:, markers])


@dataclass(frozen=True)
class MarkerTake:
    """Trajectories of M named markers in F frames.

    Unless given, frame numbers count from 0 and times are frame numbers / fps.
    """

    name: str
    fps: float  # nominal frames per second
    names: tuple[str, ...]  # unique
    positions_m: Array  # (F, M, 3) in the world, NaN where a marker was not located
    frame_numbers: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    times_s: Array = field(default_factory=lambda: np.empty(0))
    single: SingleViews | None = None  # markers seen by only one camera, if known
    notes: tuple[str, ...] = ()  # messages from the reader
    is_guessed: bool = False  # the labels were recognised from the motion, not all of them clearly
    is_trusted: bool = False  # the labels are to be used as they are, even where they contradict the motion
    is_upright: bool = False  # y is known to point up; files keep their own axes until they are imported
    cut_off_frames: int = 0  # frames that the file's header declares but the file lacks

    def __post_init__(self) -> None:
        object.__setattr__(self, "name", printable(self.name))
        object.__setattr__(self, "names", tuple(printable(name) for name in self.names))
        object.__setattr__(self, "positions_m", np.asarray(self.positions_m, dtype=np.float64))
        frames = len(self.positions_m)
        if len(self.frame_numbers) == 0:
            object.__setattr__(self, "frame_numbers", np.arange(frames))
        if len(self.times_s) == 0:
            object.__setattr__(self, "times_s", np.asarray(self.frame_numbers) / max(self.fps, 1e-9))
        if self.positions_m.shape != (frames, len(self.names), 3) or frames == 0 or not self.names:
            raise TakeError(
                f"positions of shape {self.positions_m.shape} do not match {counted(len(self.names), 'marker')}",
                where=self.name,
                advice="give x, y and z for at least one frame and one marker",
            )
        if len(set(self.names)) != len(self.names):
            raise TakeError("marker names are not unique", where=self.name, advice="give every marker its own name")
        if not 0.0 < self.fps <= MOST_FPS:
            raise TakeError(
                f"the frame rate, {self.fps:g} Hz, must be positive and at most {MOST_FPS:g} Hz",
                where=self.name,
                advice="correct it, or export the take again",
            )
        if np.shape(self.frame_numbers) != (frames,) or np.shape(self.times_s) != (frames,):
            raise TakeError(
                "frame numbers or times do not fit the number of frames",
                where=self.name,
                advice="give one for each frame",
            )
        if not np.all(np.isfinite(self.times_s)):
            raise TakeError(
                "has times that are not finite", where=self.name, advice="give every frame a time in seconds"
            )
        if self.single is not None:
            self._check_single(self.single)

    def _check_single(self, single: SingleViews) -> None:
        shape = self.positions_m.shape[:2]
        if (
            not np.issubdtype(single.cameras.dtype, np.integer)
            or single.cameras.shape != shape
            or single.points.shape != (*shape, 2)
        ):
            raise TakeError(
                "the arrays of single-camera observations do not match the markers and frames",
                where=self.name,
                advice="give a camera and a point for each marker and frame",
            )
        if not np.all((single.cameras >= -1) & (single.cameras < len(single.rig))):
            raise TakeError(
                f"a marker is seen by a camera that is not in the rig of {counted(len(single.rig), 'camera')}",
                where=self.name,
                advice="use the rig that saw the markers",
            )

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.positions_m)

    @property
    def visible(self) -> Mask:
        """Mask (F, M) of the located markers."""
        return np.all(np.isfinite(self.positions_m), axis=-1)


def save_take(take: MarkerTake, path: str | Path) -> None:
    """Write a .take.npz file (a zip of numpy arrays, no pickle)."""
    arrays = {
        "kind": _KIND,
        "version": _VERSION,
        "name": take.name,
        "fps": take.fps,
        "names": take.names,
        "positions_m": take.positions_m,
        "frame_numbers": take.frame_numbers,
        "times_s": take.times_s,
    }
    write_arrays(path, arrays | (_single_arrays(take.single) if take.single is not None else {}))


def _single_arrays(single: SingleViews) -> dict[str, NDArray[Any]]:
    cameras = single.rig.cameras
    return {
        "single_cameras": single.cameras,
        "single_points": single.points,
        "camera_names": np.array([camera.name for camera in cameras]),
        "camera_sizes": np.array([camera.image_size for camera in cameras]),
        "camera_matrices": np.array([camera.matrix for camera in cameras]),
        "camera_distortions": np.array([camera.distortion for camera in cameras]),
        "camera_rotations": np.array([camera.rotation for camera in cameras]),
        "camera_translations_m": np.array([camera.translation_m for camera in cameras]),
    }


def _single_from(stored: Mapping[str, Any]) -> SingleViews | None:
    if "single_cameras" not in stored:
        return None
    parts = ("names", "sizes", "matrices", "distortions", "rotations", "translations_m")
    rows = zip(*(stored[f"camera_{part}"] for part in parts), strict=True)
    cameras = [Camera(str(name), (int(size[0]), int(size[1])), *arrays) for name, size, *arrays in rows]
    return SingleViews(CameraRig(tuple(cameras)), stored["single_cameras"], stored["single_points"])


def load_take(path: str | Path) -> MarkerTake:
    """Return a take from a .take.npz file; TakeError if it is not one or is damaged."""
    stored = read_arrays(path, TakeError, what="is not a marker take")
    with reading(path, TakeError, what="is not a marker take"):
        if str(stored["kind"]) != _KIND or int(stored["version"]) != _VERSION:
            raise TakeError(
                "is not a marker take of this version",
                where=str(path),
                advice="update the extension, or export it again",
            )
        return MarkerTake(
            name=str(stored["name"]),
            fps=float(stored["fps"]),
            names=tuple(str(name) for name in stored["names"]),
            positions_m=stored["positions_m"],
            frame_numbers=stored["frame_numbers"].astype(np.int64, casting="same_kind"),
            times_s=stored["times_s"].astype(np.float64, casting="same_kind"),
            single=_single_from(stored),
        )
