"""Numbering and timing of the frames after a process was replaced."""

from dataclasses import dataclass, replace
from typing import Annotated

from ..markers.marker_frame import MarkerFrame
from ..system.schema import About
from .worker_settings import WORKER

_MOST = 1e12  # largest number or time in messages


@dataclass(frozen=True)
class FrameOffset:
    """Offset that continues the capture's frame numbers and times after its source was opened again."""

    number: int = 0
    time_s: float = 0.0

    def apply(self, frame: MarkerFrame) -> MarkerFrame:
        """Return the frame with its number and times shifted to those of the whole capture."""
        if self == FrameOffset():
            return frame
        times_s = frame.camera_times_s + self.time_s
        number, time_s = frame.number + self.number, frame.time_s + self.time_s
        return replace(frame, number=number, time_s=time_s, camera_times_s=times_s)


@dataclass(frozen=True)
class RestartPoint:
    """The last frame before a process was replaced."""

    number: Annotated[int, About("frame number", "", -_MOST, _MOST)]
    time_s: Annotated[float, About("time of the capture", "s", -_MOST, _MOST)]
    stamp_s: Annotated[float, About("`time.perf_counter()` at the arrival of its images", "s", -_MOST, _MOST)]
    period_s: Annotated[float, About("time from one frame number to the next", "s", 1e-6, 60.0, optional=False)] = (
        WORKER.period_s
    )

    @staticmethod
    def after(first: tuple[int, float], last: tuple[int, float], stamp_s: float) -> "RestartPoint":
        """Return the restart point for frame `last` (number, time); `first`, an earlier frame, gives the rate."""
        numbers, times_s = last[0] - first[0], last[1] - first[1]
        period_s = times_s / numbers if numbers > 0 and times_s > 0.0 else WORKER.period_s
        return RestartPoint(last[0], last[1], stamp_s, period_s)

    def moved_to(self, stamp_s: float, frame: MarkerFrame) -> "RestartPoint":
        """Return the restart point with another last frame and the same period."""
        return replace(self, number=frame.number, time_s=frame.time_s, stamp_s=stamp_s)

    def offset(self, stamp_s: float, frame: MarkerFrame) -> FrameOffset:
        """Return the offset for the new process, given its first frame and that frame's stamp."""
        passed_s = max(stamp_s - self.stamp_s, self.period_s)
        number = self.number + max(round(passed_s / self.period_s), 1)
        return FrameOffset(number - frame.number, self.time_s + passed_s - frame.time_s)

    def gap_s(self, frame: MarkerFrame) -> float:
        """Return the gap (s) between this point and the next frame, to which the offset has been applied."""
        return max(frame.time_s - self.time_s - self.period_s, 0.0)


def gap_text(seconds: float) -> str:
    """Return a phrase for the missing part of the performance."""
    return f"{seconds:.1f} s are missing" if seconds >= WORKER.gap_s else "nothing is missing"
