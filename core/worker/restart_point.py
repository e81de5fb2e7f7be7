"""Where a capture goes on after one of its processes was replaced: numbers and times that fit what was there before."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

from ..markers.marker_frame import MarkerFrame

_USUAL_PERIOD_S = 1.0 / 60.0  # where a single frame tells no rate
_TOLD_S = 0.05


@dataclass(frozen=True)
class Shift:
    """What is added to the numbers and times of a source that began anew."""

    number: int = 0
    time_s: float = 0.0

    def applied(self, frame: MarkerFrame) -> MarkerFrame:
        """Return the frame with the numbers and times of the capture."""
        if self == Shift():
            return frame
        times_s = frame.camera_times_s + self.time_s
        number, time_s = frame.number + self.number, frame.time_s + self.time_s
        return replace(frame, number=number, time_s=time_s, camera_times_s=times_s)


@dataclass(frozen=True)
class Seam:
    """The last frame before a process was replaced.

    Args:
        number, time_s: of the frame.
        stamp_s: `time.perf_counter()` when its images were in hand.
        period_s: from one frame number to the next.
    """

    number: int
    time_s: float
    stamp_s: float
    period_s: float = _USUAL_PERIOD_S

    @staticmethod
    def after(first: tuple[int, float], last: tuple[int, float], stamp_s: float) -> "Seam":
        """Return the seam after a last frame; `first` and `last` are number and time of the first and last frame."""
        numbers, times_s = last[0] - first[0], last[1] - first[1]
        period_s = times_s / numbers if numbers > 0 and times_s > 0.0 else _USUAL_PERIOD_S
        return Seam(last[0], last[1], stamp_s, period_s)

    @staticmethod
    def of_table(table: Mapping[str, Any]) -> "Seam":
        """Return the seam of `table`."""
        return Seam(int(table["number"]), float(table["time_s"]), float(table["stamp_s"]), float(table["period_s"]))

    def table(self) -> dict[str, Any]:
        """Return the seam as JSON has it."""
        return asdict(self)

    def moved_to(self, stamp_s: float, frame: MarkerFrame) -> "Seam":
        """Return the seam behind another frame."""
        return replace(self, number=frame.number, time_s=frame.time_s, stamp_s=stamp_s)

    def shift(self, stamp_s: float, frame: MarkerFrame) -> Shift:
        """Return what brings the first frame of a camera that began anew to where it belongs by the clock."""
        passed_s = max(stamp_s - self.stamp_s, self.period_s)
        number = self.number + max(round(passed_s / self.period_s), 1)
        return Shift(number - frame.number, self.time_s + passed_s - frame.time_s)

    def missing_s(self, frame: MarkerFrame) -> float:
        """Return how much of the performance is missing before the first frame (shifted) behind the seam."""
        return max(frame.time_s - self.time_s - self.period_s, 0.0)


def missing_text(seconds: float) -> str:
    """Return in plain words how much of the performance is missing."""
    return f"{seconds:.1f} s are missing" if seconds >= _TOLD_S else "nothing is missing"
