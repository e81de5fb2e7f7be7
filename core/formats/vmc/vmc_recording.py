"""Recording VMC packets as a motion or a marker take."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...body.clock import Clock, clock_of
from ...body.motion import Motion
from ...errors import TakeError, counted
from ...geometry import rotations as rot
from ...markers.marker_take import MarkerTake
from .frame_assembler import LIMITS, FrameAssembler, Key, VmcFrame, tracker_names
from .humanoid import BONES, BonePoses, motion_of_bones
from .tracker_points import axis_names, axis_points
from .vmc_packets import BONE, ROOT, TRACKERS


@dataclass(frozen=True)
class RecordingSettings:
    """Limits for interpreting recorded frames."""

    turned_rad: float = np.radians(3.0)  # smallest rotation that shows that a tracker measures rotations, too
    most_lost: float = 100.0  # most lost frames per received frame; more mean a pause, or that the clock jumped


_SETTINGS = RecordingSettings()


class Recording:
    """Recorder of VMC packets."""

    def __init__(self) -> None:
        self.gathering = FrameAssembler()
        self._frames: list[VmcFrame] = []
        self._keys: set[Key] = set()

    def add(self, packet: bytes, arrival_s: float) -> None:
        """Add a packet, as `FrameAssembler.add` does."""
        self._keep(self.gathering.add(packet, arrival_s))

    def _keep(self, frames: Sequence[VmcFrame]) -> None:
        """Keep frames with the names that arrived first, at most `LIMITS.placed`."""
        for frame in frames:
            self._keys.update([key for key in frame.placed if key not in self._keys][: LIMITS.placed - len(self._keys)])
            placed = {key: place for key, place in frame.placed.items() if key in self._keys}
            self._frames += [replace(frame, placed=placed)] * bool(placed)

    def motion(self, name: str) -> tuple[Motion, int]:
        """Return the bones' motion at the sender's rate, and the number of frames received.

        Lost frames are interpolated; a bone that a frame leaves out keeps its pose; the hips move with the root.

        Raises:
            TakeError: Fewer than two frames with bones arrived, or none with hips.
            SkeletonError: The bones are not those of an upright body.
        """
        keys = [(BONE, bone) for bone in BONES]
        frames, clock = self._with(keys, name, "bones")
        poses = _fill_missing(frames, [key for key in keys if any(key in frame.placed for frame in frames)])
        poses = _on_root(poses, frames)
        rotations, positions_m = clock.poses(poses.rotations, poses.positions_m)
        return motion_of_bones(BonePoses(poses.names, positions_m, rotations), name, clock.fps), len(frames)

    def markers(self, name: str) -> MarkerTake:
        """Return head set, controllers and trackers as markers, with the points of `tracker_points` if they rotate."""
        seen = [
            key for key in dict.fromkeys(key for frame in self._all() for key in frame.placed) if key[0] in TRACKERS
        ]
        frames, clock = self._with(seen, name, "trackers")
        names, columns = [], []
        for key, own in tracker_names(seen).items():
            there = np.array([key in frame.placed for frame in frames])
            placed = [frame.placed[key] for frame in frames if key in frame.placed]
            positions, rotations = np.array([p.position_m for p in placed]), np.array([p.rotation for p in placed])
            turns = bool(np.max(rot.angle_between(rotations, rotations[:1])) > _SETTINGS.turned_rad)
            points = np.full((len(frames), 1 + 3 * turns, 3), np.nan)
            points[there, 0] = positions
            points[there, 1:] = axis_points(positions, rotations) if turns else 0.0
            names += [own, *axis_names(own)] if turns else [own]
            columns.append(points)
        numbers = np.round(clock.times_s * clock.fps).astype(np.int64)
        if np.any(np.diff(numbers) < 1):  # the network may deliver frames almost at the same time
            numbers = np.arange(len(numbers))
        positions_m = np.concatenate(columns, axis=1)[clock.rows]
        return MarkerTake(name, clock.fps, tuple(names), positions_m, numbers, clock.times_s)

    def _all(self) -> list[VmcFrame]:
        """Return all frames, including the open one."""
        self._keep(self.gathering.end())
        return self._frames

    def _with(self, keys: Sequence[Key], name: str, what: str) -> tuple[list[VmcFrame], Clock]:
        """Return the frames that have any of the keys, and their clock, which starts at the first of them."""
        frames = [frame for frame in self._all() if any(key in frame.placed for key in keys)]
        if len(frames) < 2:
            packets = counted(self.gathering.packets, "packet")
            raise TakeError(
                f"only {counted(len(frames), 'frame')} with {what} arrived in {packets}",
                where=name,
                advice="set the other program to send them to this port at 127.0.0.1, or at this computer's address",
            )
        arrivals_s = np.array([frame.arrival_s for frame in frames])
        clocks_s = np.array([frame.clock_s for frame in frames if frame.clock_s is not None])
        is_steady = len(clocks_s) == len(frames) and bool(np.all(np.diff(clocks_s) > 0.0))
        for times_s in (clocks_s, arrivals_s) if is_steady else (arrivals_s,):
            clock = clock_of(times_s - times_s[0])
            if len(clock.steady_s) < _SETTINGS.most_lost * len(frames):
                return frames, clock
        raise TakeError("the frames arrived too unevenly to use", where=name, advice="record without a pause")


def _fill_missing(frames: Sequence[VmcFrame], keys: Sequence[Key]) -> BonePoses:
    """Return the poses of bones; a missing bone keeps its pose from the previous frame."""
    there = np.array([[key in frame.placed for key in keys] for frame in frames])
    row = np.where(there, np.arange(len(frames))[:, None], -1)
    row = np.maximum.accumulate(row, axis=0)
    row = np.where(row < 0, np.argmax(there, axis=0), row)
    placed = [[frames[r].placed[key] for r, key in zip(rows, keys, strict=True)] for rows in row]
    return BonePoses(
        tuple(name for _, name in keys),
        np.array([[bone.position_m for bone in bones] for bones in placed]),
        np.array([[bone.rotation for bone in bones] for bones in placed]),
    )


def _on_root(poses: BonePoses, frames: Sequence[VmcFrame]) -> BonePoses:
    """Return the poses with the hips in world axes instead of the root's."""
    key = (ROOT, "root")
    if poses.names[0] != "Hips" or not any(key in frame.placed for frame in frames):
        return poses
    root = _fill_missing(frames, [key])
    positions, rotations = poses.positions_m.copy(), poses.rotations.copy()
    positions[:, 0] = root.positions_m[:, 0] + rot.rotate(root.rotations[:, 0], positions[:, 0])
    rotations[:, 0] = rot.multiply(root.rotations[:, 0], rotations[:, 0])
    return BonePoses(poses.names, positions, rotations)
