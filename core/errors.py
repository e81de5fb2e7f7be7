"""Error classes: each error says where, what is wrong and what to do."""

import re

MOST_TEXT = 300  # longest message, characters
# in a message that is too long: largest length of `what`, and length that `where` always has, characters
_MOST_WHAT, _ALWAYS_WHERE = 190, 90
# list of four or more items; anchored where a clause starts, because trying every character takes quadratic time
_LIST = re.compile(r"(?:^|(?<=[,;():]))[^,;():]+(?:, [^,;():]+){3,}")
_CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029]")  # line breaks, and characters that control a terminal


def printable(text: str) -> str:
    """Return a string on one line, with control characters and surrogates escaped."""
    text = text.encode("utf-8", "backslashreplace").decode("utf-8")
    return _CONTROL.sub(lambda found: found[0].encode("unicode_escape").decode(), text)


def shorten(text: str, most: int) -> str:
    """Return a printable string, with its middle left out if it is longer than `most` characters."""
    text = printable(text)
    half = (most - 3) // 2
    return text if len(text) <= most else f"{text[:half]}...{text[-half:]}"


def counted(number: int, noun: str) -> str:
    """Return a number and its noun, which takes an "s" unless the number is 1: "1 pose", "2 poses"."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def fit_sentence(text: str, most: int) -> str:
    """Return a printable sentence of at most `most` characters: lists are cut first, then the end, never the start."""
    text = printable(text)
    for found in sorted(_LIST.findall(text), key=len, reverse=True):
        items = found.split(", ")
        kept = min(len(items), most)  # more items than characters never fit
        while len(text) > most and kept > 2:
            kept -= 1
            shorter = f"{', '.join(items[:kept])} and {len(items) - kept} more"
            text, found = text.replace(found, shorter), shorter
    if len(text) <= most:
        return text
    cut = text[: max(most - 3, 0)]
    return (cut.rsplit(" ", 1)[0].rstrip(" ,;:(") or cut) + "..."[:most]


def _fit_place(text: str, most: int) -> str:
    """Return a printable place of at most `most` characters that keeps its end: file name and line."""
    text = printable(text)
    return text if len(text) <= most else "..." + text[3 - most :]


class PerfanimError(Exception):
    """Base of all errors, reported to the user in one line.

    Args:
        what: What is wrong, in plain words.
        where: File, line, frame, camera, ... ("" if there is no place).
        advice: What the user can do about it.
    """

    def __init__(self, what: str, *, where: str = "", advice: str = "") -> None:
        where, what, advice = map(printable, (where, what, advice))
        if len(where) + len(what) + len(advice) + 4 > MOST_TEXT:
            what = fit_sentence(what, _MOST_WHAT)
            where = _fit_place(where, max(_ALWAYS_WHERE, MOST_TEXT - 4 - len(what) - len(advice)))
            where = _fit_place(where, MOST_TEXT - 4 - len(what))
            advice = fit_sentence(advice, MOST_TEXT - 4 - len(what) - len(where))
        self.what = what
        self.where = where
        self.advice = advice
        place = f"{where}: " if where else ""
        hint = f"; {advice}" if advice else ""
        super().__init__(f"{place}{what}{hint}")


class FormatError(PerfanimError):
    """A file is of the wrong kind, or is damaged."""


class SkeletonError(PerfanimError):
    """A skeleton is inconsistent or lacks a joint."""


class SettingsError(PerfanimError):
    """A setting is out of range."""


class MarkerSetError(PerfanimError):
    """A marker set is inconsistent or does not fit its skeleton."""


class TakeError(PerfanimError):
    """A take is unusable for the requested task."""


class SubjectError(PerfanimError):
    """A subject calibration failed or does not fit."""


class PropError(PerfanimError):
    """A prop's markers look the same in two poses, or its definition is damaged."""


class DatabaseError(PerfanimError):
    """A motion database is missing, empty, damaged or of an unsupported version."""


class CalibrationError(PerfanimError):
    """Cameras could not be calibrated, or a calibration does not fit the images."""


class CaptureError(PerfanimError):
    """A camera, video or the capture process failed."""


class DownloadError(PerfanimError):
    """A file cannot be downloaded, or is damaged after the download."""


class CharacterError(PerfanimError):
    """A character cannot be driven."""
