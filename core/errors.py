"""Error tree: each error has a fact, a place and an advice."""


class PerfanimError(Exception):
    """Base of all errors that are reported to the user in one line.

    Args:
        what: the fact, in plain words.
        where: file, line, frame, camera, ... ("" when there is no place).
        advice: what the user can do about it.
    """

    def __init__(self, what: str, *, where: str = "", advice: str = "") -> None:
        self.what = what
        self.where = where
        self.advice = advice
        place = f"{where}: " if where else ""
        hint = f"; {advice}" if advice else ""
        super().__init__(f"{place}{what}{hint}")


class FormatError(PerfanimError):
    """A file is of another kind or damaged."""


class SkeletonError(PerfanimError):
    """A skeleton is inconsistent or lacks a joint."""


class SettingsError(PerfanimError):
    """A setting is out of its range."""


class MarkerSetError(PerfanimError):
    """A marker set is inconsistent or does not fit its skeleton."""


class TakeError(PerfanimError):
    """A take is unusable for the requested task."""


class SubjectError(PerfanimError):
    """A subject calibration failed or does not fit."""


class PropError(PerfanimError):
    """A prop looks the same in another position, or its definition is damaged."""


class DatabaseError(PerfanimError):
    """A motion database is missing, empty, damaged or of another version."""


class CalibrationError(PerfanimError):
    """Cameras could not be calibrated, or a calibration does not fit the images."""


class CaptureError(PerfanimError):
    """A camera, video or the capture process failed."""


class CharacterError(PerfanimError):
    """A character cannot be driven."""
