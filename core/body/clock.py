"""Clock of a take: the times of its frames and the steady rate of its outputs.

Files round the times of frames, cameras jitter, and some frames are lost. So the rate is a property of the outputs: the
header's rate if the times agree with it, otherwise another steady rate that explains all times, otherwise the common
rate that is nearest. Poses and markers are interpolated at the times of the output frames.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property

import numpy as np

from ..errors import TakeError
from ..geometry import rotations as rot
from ..geometry.arrays import Array, IntArray, Mask, runs
from ..geometry.cubic_curves import hermite
from .motion import LEAST_FPS, MOST_FPS, Motion
from .skeleton import Skeleton

PAUSE_S = 0.25  # time between two frames above which the motion between them is unknown


@dataclass(frozen=True)
class ClockSettings:
    """Thresholds for finding the steady rate of frame times."""

    # common rates of cameras, film and motion capture systems, Hz
    usual_hz: tuple[float, ...] = (
        10, 12, 15, 20, 24, 25, 30, 48, 50, 60, 72, 75, 90, 100, 120, 144, 150, 180, 200, 240, 250, 300, 360, 400, 480,
        500, 600, 1000,
    )  # fmt: skip
    roundings_s: tuple[float, ...] = (1e-2, 1e-3, 1e-4, 1e-5, 1e-6)  # units to which files may round times, s
    same: float = 0.02  # largest deviation of a time from a steady rate, frames
    widest: float = 0.45  # largest rounding error of times that is accepted without frame numbers, frames
    near: float = 0.01  # largest relative difference from a common rate that is attributed to the camera's clock
    lost: float = 3.0  # longest step that is used to measure the rate, in median steps; a longer one is a gap
    plausible_hz: tuple[float, float] = (5.0, 5000.0)  # lowest and highest rate of markers; tells the unit of times
    uneven: float = 0.5  # smallest deviation of a step from one frame interval that is reported, frames
    near_s: float = 0.1  # longest step across which markers and props are interpolated, s
    longest_s: float = 1.0  # longest transition between two poses, s; in longer steps the first pose is held before it


CLOCK = ClockSettings()
_SECONDS_PER_TICK = (1.0, 1e-3, 1e-6, 1e-9)  # possible units of times in files, s


class ClockFault(Enum):
    """Kinds of faults in the times of frames."""

    UNEVEN = "frames are unevenly spaced"
    LOST = "frames are missing"
    HEADER = "the header contradicts the times"
    ORDER = "times do not ascend"


@dataclass(frozen=True)
class ClockNote:
    """Fault in the times, with a sentence about it."""

    kind: ClockFault
    text: str


@dataclass(frozen=True)
class Clock:
    """Times of frames and the steady rate of their outputs; made by `clock_of`.

    Args:
        rows: Frames (R,) with ascending times; the others have no usable time.
        times_s: Times (R,) of these frames, without the rounding of the file.
        fps: Steady rate of the outputs.
        is_steady: Whether every time is a whole number of frames after the first.
        stated_fps: Rate stated in the header; None if there is none.
        frames: Number of all frames.
    """

    rows: IntArray
    times_s: Array
    fps: float
    is_steady: bool
    stated_fps: float | None
    frames: int

    @property
    def source_s(self) -> float:
        """Time from the first to the last frame, s."""
        return float(self.times_s[-1] - self.times_s[0])

    @property
    def mean_fps(self) -> float:
        """Mean number of frames per second."""
        return (len(self.rows) - 1) / self.source_s if self.source_s > 0.0 else self.fps

    @property
    def steps_s(self) -> tuple[float, float]:
        """Shortest and longest time between two frames; zero for a single frame."""
        steps = np.diff(self.times_s)
        return (float(steps.min()), float(steps.max())) if len(steps) else (0.0, 0.0)

    @cached_property
    def steady_s(self) -> Array:
        """Times (N,) of the output frames, between the first and the last input frame."""
        count = int(np.floor(self.source_s * self.fps + CLOCK.same)) + 1
        return self.times_s[0] + np.arange(count) / self.fps

    @cached_property
    def nearest(self) -> IntArray:
        """Frames (N,) nearest to the steady times."""
        middles_s = 0.5 * (self.times_s[1:] + self.times_s[:-1])
        return self.rows[np.searchsorted(middles_s, self.steady_s)]

    @property
    def is_whole(self) -> bool:
        """Whether the output has exactly the input's frames."""
        return self.is_steady and len(self.rows) == len(self.steady_s) == self.frames

    @property
    def notes(self) -> list[ClockNote]:
        """Faults in the times that the user should know about."""
        return [*_order_notes(self), *_header_notes(self), *_step_notes(self)]

    @property
    def lost(self) -> int:
        """Number of missing frames at a steady rate; 0 if the frames are uneven."""
        return max(len(self.steady_s) - len(self.rows), 0) if self.is_steady else 0

    @property
    def sentences(self) -> list[str]:
        """The notes in words."""
        return [note.text for note in self.notes]

    def motion(self, name: str, skeleton: Skeleton, rotations: Array, root_positions_m: Array) -> Motion:
        """Return rotations (F, J, 4) and root positions (F, 3) as a motion at the steady rate."""
        return Motion(name, self.fps, skeleton, *self.poses(rotations, root_positions_m))

    def poses(self, rotations: Array, positions_m: Array) -> tuple[Array, Array]:
        """Return rotations (F, ..., 4) and positions (F, ..., 3) at the steady times."""
        if self.is_whole:
            return rotations, positions_m
        known = rotations[self.rows], positions_m[self.rows]
        return poses_at(self.times_s, *known, self.steady_s)

    def seen(self, values: Array, visible: Mask, *, is_rotation: bool = False) -> Array:
        """Return values (F, n) at the steady times, interpolated between frames of the mask `visible` (F,).

        The result is NaN where frames were lost at a steady rate, between frames far apart, and next to hidden values.
        """
        if self.is_whole:
            return np.where(visible[:, None], values, np.nan)
        known, found = values[self.rows], np.full((len(self.steady_s), values.shape[1]), np.nan)
        for start, stop in runs(visible[self.rows]):
            times_s = self.times_s[start:stop]
            inside = np.flatnonzero((self.steady_s > times_s[0] - 1e-9) & (self.steady_s < times_s[-1] + 1e-9))
            _, share, step_s = _places(times_s, self.steady_s[inside])
            near = (share == 0.0) | (share == 1.0) | (not self.is_steady) & (step_s <= CLOCK.near_s)
            found[inside[near]] = _between(times_s, known[start:stop], self.steady_s[inside[near]], is_rotation)
        return found

    def at(self, fps: float | None) -> "Clock":
        """Return the clock for another output rate; None keeps the rate."""
        return self if fps is None or fps == self.fps else replace(self, fps=fps, is_steady=False)

    def part(self, start: int, stop: int) -> "Clock":
        """Return the clock of the frames from `start` up to but not including `stop`."""
        kept = (self.rows >= start) & (self.rows < stop)
        return replace(self, rows=self.rows[kept] - start, times_s=self.times_s[kept], frames=stop - start)

    def filtered(self, values: Array, change: Callable[[Array], Array], *, is_rotation: bool = False) -> Array:
        """Return values (F, ..., n) filtered at the steady rate, at their own times; a single frame is unchanged."""
        if len(self.rows) < 2:
            return values
        if self.is_whole:
            return change(values)
        changed = change(_between(self.times_s, values[self.rows], self.steady_s, is_rotation))
        at_s = np.interp(np.arange(self.frames), self.rows, self.times_s)
        return _between(self.steady_s, changed, np.minimum(at_s, self.steady_s[-1]), is_rotation)


def clock_of(times_s: Array, stated_fps: float | None = None, numbers: IntArray | None = None) -> Clock:
    """Return the clock for given frame times.

    Args:
        times_s: Times (F,) of the frames; frames whose times do not ascend, or are NaN, get no time.
        stated_fps: Rate stated in a header; None, zero or NaN if there is none.
        numbers: Frame numbers (F,), which can replace times that were rounded.

    Raises:
        TakeError: No frame has a time, or no two frames have different times and no rate is stated.
    """
    stated_fps = stated_fps if stated_fps is not None and stated_fps > 0.0 else None
    if stated_fps is not None and numbers is not None and _count_time(times_s, numbers, stated_fps):
        exact_s = times_s[0] + (numbers - numbers[0]) / stated_fps
        return Clock(np.arange(len(times_s)), exact_s, stated_fps, True, stated_fps, len(times_s))
    rows = _ascending(times_s)
    if len(rows) < 2:
        if stated_fps is None or not len(rows):
            raise TakeError("has too few frames to determine its frame rate", advice="record a longer take")
        return Clock(rows, times_s[rows], stated_fps, True, stated_fps, len(times_s))
    known_s = times_s[rows]
    for fps in _candidates(known_s, stated_fps):
        places = _steady_places(known_s, fps)
        if places is not None:
            return Clock(rows, known_s[0] + places / fps, fps, True, stated_fps, len(times_s))
    steps_s = np.diff(known_s)
    step_s = float(np.mean(steps_s[steps_s <= CLOCK.lost * np.median(steps_s)]))
    return Clock(rows, known_s, _usual(1.0 / step_s), False, stated_fps, len(times_s))


def _ascending(times_s: Array) -> IntArray:
    """Return the frames (R,) with finite, strictly ascending times; those that jump ahead or back are left out."""
    finite = np.flatnonzero(np.isfinite(times_s))
    known_s = times_s[finite]
    latest_s = np.maximum.accumulate(np.concatenate(([-np.inf], known_s)))[:-1]
    earliest_s = np.minimum.accumulate(np.concatenate((known_s, [np.inf]))[::-1])[::-1][1:]
    return max((finite[kept] for kept in (known_s > latest_s, known_s < earliest_s)), key=len)


def seconds_of(times: Array, stated_fps: float | None = None) -> Array:
    """Return times (F,) in seconds, converted from an unknown unit between seconds and nanoseconds.

    Args:
        stated_fps: Rate stated in a header, which tells the unit; without it, the first unit is used that gives a rate
            of 5 to 5,000 Hz.
    """
    steps = np.diff(times[np.isfinite(times)])
    steps = steps[steps > 0.0]
    if not len(steps):
        return times
    has_rate = stated_fps is not None and stated_fps > 0.0
    low, high = (0.5 * stated_fps, 2.0 * stated_fps) if has_rate and stated_fps else CLOCK.plausible_hz
    per_tick = (each for each in _SECONDS_PER_TICK if low <= 1.0 / (float(np.median(steps)) * each) <= high)
    unit_s = next(per_tick, 1.0)
    return times if unit_s == 1.0 else (times - times[np.isfinite(times)][0]) * unit_s


def poses_at(times_s: Array, rotations: Array, positions_m: Array, wanted_s: Array) -> tuple[Array, Array]:
    """Return the poses at other times, interpolated between the given poses.

    Short steps are interpolated with a cubic, longer ones along the shortest arc. In a very long step the first pose
    is held until shortly before the second.

    Args:
        times_s: Ascending times (F,).
        rotations, positions_m: Rotations (F, ..., 4) and positions (F, ..., 3).
        wanted_s: Times (N,), none before the first given pose or after the last.
    """
    return _between(times_s, rotations, wanted_s, True), _between(times_s, positions_m, wanted_s, False)


def _candidates(times_s: Array, stated_fps: float | None) -> list[float]:
    """Return steady rates that may explain the times, the likeliest first."""
    steps = np.diff(times_s)
    mean = len(steps) / float(times_s[-1] - times_s[0])
    measured = [mean, 1.0 / float(np.median(steps)), 1.0 / float(np.quantile(steps, 0.1))]
    found = [stated_fps] if stated_fps is not None else []
    for rate in measured:
        whole = float(round(rate))
        found += [whole, 1000.0 * whole / 1001.0]  # the second is an NTSC rate
    if abs(_usual(mean) / mean - 1.0) > CLOCK.near:
        found.append(mean)
    return [rate for rate in found if LEAST_FPS <= rate <= MOST_FPS]


def _count_time(times_s: Array, numbers: IntArray, fps: float) -> bool:
    """Return whether frame numbers (F,) explain the given times up to their rounding."""
    if not len(times_s) or not np.all(np.isfinite(times_s)) or np.any(np.diff(numbers) < 1):
        return False
    return bool(np.ptp(times_s - numbers / fps) <= _rounding_s(times_s) + CLOCK.same / fps)


def _steady_places(times_s: Array, fps: float) -> IntArray | None:
    """Return the numbers of frames (R,) since the first that explain times (R,) at a rate, or None."""
    since_s = times_s - times_s[0]
    places = np.round(since_s * fps).astype(np.int64)
    most_s = min(_rounding_s(times_s) + CLOCK.same / fps, CLOCK.widest / fps)
    is_steady = np.min(np.diff(places)) == 1 and np.ptp(since_s - places / fps) <= most_s
    return places if is_steady else None


def _rounding_s(times_s: Array) -> float:
    """Return the unit to which times were rounded, s, or 0 if they were not."""
    for unit_s in CLOCK.roundings_s:
        ticks = times_s / unit_s
        if np.all(np.abs(ticks - np.round(ticks)) < 1e-3):
            return unit_s
    return 0.0


def _usual(fps: float) -> float:
    """Return the common rate that is nearest to a rate on a logarithmic scale."""
    return min((float(rate) for rate in CLOCK.usual_hz), key=lambda rate: abs(np.log(rate / fps)))


def _places(times_s: Array, wanted_s: Array) -> tuple[IntArray, Array, Array]:
    """Return, for each wanted time, the preceding frame, the fraction of the transition, and the step's length, s."""
    if len(times_s) < 2:
        nothing = np.zeros(len(wanted_s))
        return nothing.astype(np.int64), nothing, nothing
    before = np.clip(np.searchsorted(times_s, wanted_s, side="right") - 1, 0, len(times_s) - 2)
    step_s = times_s[before + 1] - times_s[before]
    start_s = np.maximum(times_s[before], times_s[before + 1] - CLOCK.longest_s)
    share = np.clip((wanted_s - start_s) / (times_s[before + 1] - start_s), 0.0, 1.0)
    nearest = np.round(share)
    return before, np.where(np.abs(share - nearest) < 1e-6, nearest, share), step_s


def _between(times_s: Array, values: Array, wanted_s: Array, is_rotation: bool) -> Array:
    """Return values (F, ..., n) interpolated at wanted times (N,)."""
    before, share, step_s = _places(times_s, wanted_s)
    found = values[before + (share == 1.0)]
    apart = (share > 0.0) & (share < 1.0)
    long, short = np.flatnonzero(apart & (step_s > PAUSE_S)), np.flatnonzero(apart & (step_s <= PAUSE_S))
    if len(long):
        start, end = values[before[long]], values[before[long] + 1]
        part = share[long].reshape(-1, *[1] * (values.ndim - 1))
        if is_rotation:
            found[long] = rot.slerp(start, end, np.broadcast_to(part[..., 0], start.shape[:-1]))
        else:
            found[long] = start + part * (end - start)
    if len(short):
        smooth = rot.continuous(values) if is_rotation else values
        curve = hermite(times_s, smooth, np.gradient(smooth, times_s, axis=0), wanted_s[short])
        found[short] = rot.normalize(curve) if is_rotation else curve
    return found


def _order_notes(clock: Clock) -> list[ClockNote]:
    left = clock.frames - len(clock.rows)
    text = f"times are missing or do not ascend: {left} of {clock.frames} frames are left out of the output"
    return [ClockNote(ClockFault.ORDER, text)] * (left > 0)


def _header_notes(clock: Clock) -> list[ClockNote]:
    stated = clock.stated_fps
    # if frames are unevenly spaced, a header can only state the mean rate
    if stated is None or any(abs(stated / fps - 1.0) <= CLOCK.near for fps in (clock.fps, clock.mean_fps)):
        return []
    text = (
        f"the header says {stated:g} frames per second, but the times give {clock.mean_fps:.4g} on average: the times "
        f"are used, and outputs have {clock.fps:.4g} per second"
    )
    return [ClockNote(ClockFault.HEADER, text)]


def _step_notes(clock: Clock) -> list[ClockNote]:
    least_s, most_s = clock.steps_s
    if not clock.is_steady and max(most_s * clock.fps - 1.0, 1.0 - least_s * clock.fps) > CLOCK.uneven:
        text = (
            f"frames are unevenly spaced, {1e3 * least_s:.0f} to {1e3 * most_s:.0f} ms apart, {clock.mean_fps:.1f} per "
            f"second on average: outputs have {clock.fps:g} per second, interpolated by the frames' times"
        )
        return [ClockNote(ClockFault.UNEVEN, text), *_long_note(most_s)]
    if clock.lost:
        text = (
            f"{clock.lost} of {len(clock.steady_s)} frames are missing, at most {most_s:.2f} s in a row "
            f"({clock.mean_fps:.1f} frames per second on average): motion is interpolated there, markers are not"
        )
        return [ClockNote(ClockFault.LOST, text), *_long_note(most_s)]
    return []


def _long_note(most_s: float) -> list[ClockNote]:
    text = (
        f"no frames for up to {most_s:.1f} s: the pose is held there, and moves to the next one in the last "
        f"{CLOCK.longest_s:g} s"
    )
    return [ClockNote(ClockFault.LOST, text)] * (most_s > CLOCK.longest_s)
