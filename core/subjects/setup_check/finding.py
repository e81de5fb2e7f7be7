"""Findings of the setup check in plain words."""

from dataclasses import dataclass
from enum import StrEnum

Place = tuple[int, float, float]  # camera index, x and y in pixels


class Fault(StrEnum):
    """Kinds of faults that the check can find."""

    DARK = "too dark"
    BRIGHT = "too bright"
    BLURRED = "out of focus"
    SHUTTER = "shutter too slow"
    REFLECTION = "reflection"
    EXCHANGED = "cameras exchanged"
    FLIPPED = "images mirrored or turned"
    BUMPED = "camera bumped"
    CLOSE = "too close"
    FAR = "too far"
    BOARD_SMALL = "board too small"
    SQUARE_SIZE = "wrong square size"
    MARKER_MISSING = "marker missing"


class PersonFault(StrEnum):
    """Kinds of faults that the check of a person without markers can find."""

    NOBODY = "nobody in view"
    DARK = "too dark"
    SMALL = "too far"
    CUT_OFF = "body cut off"
    APART = "cameras do not agree"
    ANGLE = "angle between cameras"
    OTHERS = "somebody else in view"


# faults that the pictures of a single camera show, calibrated or not
PICTURE_FAULTS = frozenset({Fault.DARK, Fault.BRIGHT, Fault.BLURRED, Fault.SHUTTER, Fault.REFLECTION})


@dataclass(frozen=True)
class Finding:
    """A fault, its location and advice.

    Args:
        where: Title of the camera; "" if the fault concerns all.
        text: Fact and advice as a sentence.
        places: Positions in images around which rings are drawn.
    """

    fault: Fault | PersonFault
    where: str
    text: str
    places: tuple[Place, ...] = ()
