"""What comes in VMC packets, gathered into frames, and these as motion or as marker take."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .. import rotations as rot
from ..errors import FormatError, TakeError
from ..marker_take import MarkerTake
from ..motion import Motion
from ..take_file.reading import rate
from .humanoid import BONES, BonePoses, motion_of_bones
from .packets import BONE, ROOT, TRACKERS, Clock, Placed, read_packet

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

_ON_A_FRAME = 0.01  # of a frame: nearer than this to a frame is that frame; stamps are 32-bit numbers
_MOST_LOST = 100  # frames for each that came; more are no loss but a clock that jumped, or a pause
_Key = tuple[str, str]  # address and name


@dataclass(frozen=True)
class _Frame:
    arrival_s: float
    clock_s: float | None
    placed: dict[_Key, Placed]


class Recording:
    """Frames of VMC packets.

    A frame ends where something that it has comes again, so it does not matter over how many packets a program spreads
    its frames, nor in which order.
    """

    def __init__(self) -> None:
        self.packets = 0
        self.malformed = 0
        self._frames: list[_Frame] = []
        self._clear()

    def _clear(self) -> None:
        self._arrival_s = 0.0
        self._clock_s: float | None = None
        self._placed: dict[_Key, Placed] = {}

    def add(self, packet: bytes, arrival_s: float) -> None:
        """Take a packet in; a malformed one is counted and has no effect.

        Args:
            packet: a UDP datagram.
            arrival_s: when it came, by any clock that only goes forwards.
        """
        self.packets += 1
        try:
            messages = read_packet(packet)
        except FormatError:
            self.malformed += 1
            return
        for message in messages:
            self._add(message, arrival_s)

    def _add(self, message: Placed | Clock, arrival_s: float) -> None:
        if isinstance(message, Clock):
            again = self._clock_s is not None
        else:
            again = (message.address, message.name) in self._placed
        if again:
            self._end_frame()
        if self._clock_s is None and not self._placed:
            self._arrival_s = arrival_s
        if isinstance(message, Clock):
            self._clock_s = message.time_s
        else:
            self._placed[message.address, message.name] = message

    def _end_frame(self) -> None:
        if self._placed:
            self._frames.append(_Frame(self._arrival_s, self._clock_s, self._placed))
        self._clear()

    def motion(self, name: str) -> tuple[Motion, int]:
        """Return the bones' motion at the sender's rate, and how many frames of it came.

        Frames that were lost lie between their neighbours. A bone that a frame leaves out stays as it was. The root
        carries the hips.

        Raises:
            TakeError: fewer than two frames with bones came, or none with hips.
            SkeletonError: the bones make no body.
        """
        keys = [(BONE, bone) for bone in BONES]
        frames, times_s, fps = self._with(keys, name, "bones")
        poses = _filled(frames, [key for key in keys if any(key in frame.placed for frame in frames)])
        poses = _on_root(poses, frames)
        return motion_of_bones(_at_rate(poses, times_s, fps), name, fps), len(frames)

    def markers(self, name: str) -> MarkerTake:
        """Return head set, controllers and trackers as markers called by their serial numbers.

        Raises:
            TakeError: fewer than two frames with any of them came.
        """
        seen = dict.fromkeys(key for frame in self._all() for key in frame.placed if key[0] in TRACKERS)
        frames, times_s, fps = self._with(list(seen), name, "trackers")
        positions = np.full((len(frames), len(seen), 3), np.nan)
        for row, frame in enumerate(frames):
            for column, key in enumerate(seen):
                if key in frame.placed:
                    positions[row, column] = frame.placed[key].position_m
        numbers = np.round(times_s * fps).astype(np.int64)
        if np.any(np.diff(numbers) < 1):  # arrival times of a network may crowd
            numbers = np.arange(len(frames))
        return MarkerTake(name, fps, _marker_names(list(seen)), positions, numbers, times_s)

    def _all(self) -> list[_Frame]:
        """Return all frames, the one that is still open with them."""
        last = [_Frame(self._arrival_s, self._clock_s, self._placed)] if self._placed else []
        return self._frames + last

    def _with(self, keys: Sequence[_Key], name: str, what: str) -> tuple[list[_Frame], Array, float]:
        """Return the frames that have one of the keys, their times (F,) from the first, and their rate."""
        frames = [frame for frame in self._all() if any(key in frame.placed for key in keys)]
        if len(frames) < 2:
            raise TakeError(
                f"{len(frames)} frames with {what} came in {self.packets} packets",
                where=name,
                advice="let the other program send them to this computer and port",
            )
        arrivals_s = np.array([frame.arrival_s for frame in frames])
        clocks_s = np.array([frame.clock_s for frame in frames if frame.clock_s is not None])
        is_steady = len(clocks_s) == len(frames) and bool(np.all(np.diff(clocks_s) > 0.0))
        for times_s in (clocks_s, arrivals_s) if is_steady else (arrivals_s,):
            from_first_s = times_s - times_s[0]
            fps = rate(from_first_s, np.arange(len(frames)))
            if from_first_s[-1] * fps < _MOST_LOST * len(frames):
                return frames, from_first_s, fps
        raise TakeError(
            "frames came too unevenly to make anything of them", where=name, advice="record without a pause"
        )


def _marker_names(keys: Sequence[_Key]) -> tuple[str, ...]:
    names = [name or TRACKERS[address] for address, name in keys]
    return tuple(
        name if names.count(name) == 1 else f"{TRACKERS[address]}:{name}"
        for name, (address, _) in zip(names, keys, strict=True)
    )


def _filled(frames: Sequence[_Frame], keys: Sequence[_Key]) -> BonePoses:
    """Return the poses of bones; where a frame lacks one, it is as in the frame before, or as it first came."""
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


def _on_root(poses: BonePoses, frames: Sequence[_Frame]) -> BonePoses:
    """Return the poses with the hips in the world."""
    key = (ROOT, "root")
    if poses.names[0] != "Hips" or not any(key in frame.placed for frame in frames):
        return poses
    root = _filled(frames, [key])
    positions, rotations = poses.positions_m.copy(), poses.rotations.copy()
    positions[:, 0] = root.positions_m[:, 0] + rot.rotate(root.rotations[:, 0], positions[:, 0])
    rotations[:, 0] = rot.multiply(root.rotations[:, 0], rotations[:, 0])
    return BonePoses(poses.names, positions, rotations)


def _at_rate(poses: BonePoses, times_s: Array, fps: float) -> BonePoses:
    """Return the poses at multiples of the frame time."""
    times_s = np.maximum.accumulate(times_s)
    wanted = np.arange(round(float(times_s[-1]) * fps) + 1) / fps
    after = np.clip(np.searchsorted(times_s, wanted), 1, len(times_s) - 1)
    before = after - 1
    step = np.maximum(times_s[after] - times_s[before], 1e-9)
    share = np.clip((wanted - times_s[before]) / step, 0.0, 1.0)
    share = np.where(np.abs(share - np.round(share)) < _ON_A_FRAME, np.round(share), share)
    start, end = poses.rotations[before], poses.rotations[after]
    positions = poses.positions_m
    return BonePoses(
        poses.names,
        positions[before] + share[:, None, None] * (positions[after] - positions[before]),
        rot.slerp(start, end, np.broadcast_to(share[:, None], start.shape[:2])),
    )
