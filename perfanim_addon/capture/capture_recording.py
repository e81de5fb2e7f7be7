"""Recorded part of a capture: from the end of a countdown, for a given duration."""

import math
import time
from collections.abc import Callable, Sequence
from enum import Enum

from ...core.body.scene_pose import ScenePose


class Cue(Enum):
    """Sounds for the performer; the values are pitches in Hz."""

    COUNT = 440.0
    BEGIN = 880.0
    END = 660.0


class Recording:
    """One recorded part of a capture.

    Args:
        countdown_s: Time from the first pose, or with `later` from now, to the first recorded pose.
        length_s: Duration measured by the poses' times; 0 records until `end`.
        later: The recording starts during the capture, without the poses so far.
    """

    def __init__(
        self,
        countdown_s: float = 0.0,
        length_s: float = 0.0,
        later: bool = False,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        self.begun = self.over = False
        self.seconds_left = 0  # remaining time of the countdown
        self.start_frame = 1.0  # scene frame of the first pose
        self._countdown_s = countdown_s
        self._length_s = length_s
        self._from_now = later or countdown_s > 0.0
        self._clock = clock
        self._due_s: float | None = None
        self._first = 0
        self._stop: int | None = None

    def advance(self, poses: Sequence[ScenePose]) -> Cue | None:
        """Update with the poses of the capture so far; return the sound to play."""
        if not poses or self.over:
            return None
        if not self.begun:
            return self._count_down(poses)
        if self._length_s and poses[-1].time_s - poses[min(self._first, len(poses) - 1)].time_s >= self._length_s:
            self.over = True
            return Cue.END
        return None

    def _count_down(self, poses: Sequence[ScenePose]) -> Cue | None:
        now = self._clock()
        if self._due_s is None:
            self._due_s = now + self._countdown_s
        if now >= self._due_s:
            self.begun, self.seconds_left = True, 0
            self._first = len(poses) if self._from_now else 0
            return Cue.BEGIN if self._from_now else None
        left = math.ceil(self._due_s - now)
        if left == self.seconds_left:
            return None
        self.seconds_left = left
        return Cue.COUNT

    def seconds(self, poses: Sequence[ScenePose]) -> float:
        """Return the recorded time so far, by the poses' times."""
        return poses[-1].time_s - poses[min(self._first, len(poses) - 1)].time_s if self.begun else 0.0

    def end(self, poses: Sequence[ScenePose], cut_s: float = 0.0) -> None:
        """End the recording with the newest pose, or `cut_s` before it; during the countdown it ends empty."""
        self.over, self.seconds_left, self._stop = True, 0, len(poses)
        while self._stop > self._first + 1 and poses[-1].time_s - poses[self._stop - 1].time_s < cut_s:
            self._stop -= 1

    def recorded(self, poses: Sequence[ScenePose]) -> list[ScenePose]:
        """Return those poses of a capture that belong to the recording."""
        kept = list(poses[self._first : self._stop]) if self.begun else []
        if kept and self._length_s:
            end_s = kept[0].time_s + self._length_s
            return [pose for pose in kept if pose.time_s <= end_s]
        return kept
