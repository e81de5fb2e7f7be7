"""Faults in how cameras see a person without markers."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ...errors import CaptureError
from ...geometry.arrays import Array, FloatArray, Image
from ...geometry.camera import CameraRig
from ...markers.marker_frame import MarkerFrame
from ...markers.marker_set import MarkerSet
from ...vision.people.people_pipeline import APART
from ...vision.sources.image_set import ImageSet, camera_title
from .finding import Finding, PersonFault

_PARTS = {"feet": ("foot", "toes"), "hands": ("wrist", "hand", "fingers", "thumb"), "head": ("head",)}  # joints


@dataclass(frozen=True)
class PersonLimits:
    """Limits that pictures of a person without faults meet."""

    shown: float = 0.6  # share of the pictures that show the person, and each part of the body
    visible: float = 0.5  # probability of being visible from which a point counts as seen
    least_px: float = 120.0  # extent of the body; the network looks at 256 pixels
    dark: float = 40.0  # median grey level of the person
    angles_deg: tuple[float, float] = (40.0, 140.0)  # between two cameras, seen from the person
    fewest: int = 10  # moments
    others: int = 2  # pictures of a camera that show somebody else


_LIMITS = PersonLimits()


@dataclass(frozen=True)
class _Sight:
    """The person in one picture.

    Args:
        parts: Whether each of `_PARTS` is seen.
        extent_px: Larger side of the box round the points.
        level: Median grey level in that box.
    """

    parts: tuple[bool, ...]
    extent_px: float
    level: float


def check_person(rig: CameraRig, points: MarkerSet, moments: Iterable[tuple[ImageSet, MarkerFrame]]) -> list[Finding]:
    """Return the faults to fix first, or an empty list if all is well.

    Args:
        rig: Calibrated cameras.
        points: The network's points.
        moments: Images of a person who walks about, and what `PeoplePipeline.process` found in them.

    Raises:
        CaptureError: There are too few images.
    """
    joints = [marker.joint.removeprefix("l").removeprefix("r") for marker in points.markers]
    parts = [np.array([joint in of_part for joint in joints]) for of_part in _PARTS.values()]
    sights: list[list[_Sight | None]] = [[] for _ in rig.cameras]
    frames: list[MarkerFrame] = []
    for images, frame in moments:
        frames.append(frame)
        for seen, image, rows, use in zip(sights, images.images, frame.detected, images.usable, strict=True):
            if use:
                seen.append(_sight(image, rows, parts) if len(rows) else None)
    if len(frames) < _LIMITS.fewest:
        raise CaptureError(f"{len(frames)} moments are too few for a check", advice="record six seconds of walking")
    names = [camera.name for camera in rig.cameras]
    found = [fault for index, seen in enumerate(sights) for fault in _camera_faults(camera_title(index, names), seen)]
    return found or _rig_faults(rig, frames)


def check_others(rig: CameraRig, middles_px: Sequence[Array]) -> list[Finding]:
    """Return a finding for each camera that shows somebody else in several pictures.

    In a single one, things are sometimes taken for a person.

    Args:
        rig: Calibrated cameras.
        middles_px: For each camera, the positions (N, 2) of others in the pictures that show any.
    """
    names = [camera.name for camera in rig.cameras]
    found = []
    for index, middles in enumerate(middles_px):
        if len(middles) >= _LIMITS.others:
            title, (x, y) = camera_title(index, names), np.median(middles, axis=0).tolist()
            text = f"{title} shows somebody else: ask them to leave the picture, or they may be followed in your place"
            found.append(Finding(PersonFault.OTHERS, title, text, ((index, x, y),)))
    return found


def _sight(image: Image, rows: FloatArray, parts: Sequence[Array]) -> _Sight:
    height, width = image.shape[:2]
    pixels, visible = rows[:, :2], rows[:, 3] >= 255.0 * _LIMITS.visible
    inside = np.all((pixels >= 0.0) & (pixels < (width, height)), axis=1)
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    (left, top), (right, bottom) = np.clip((low, high), 0.0, (width, height)).astype(int).tolist()
    box = image[top : bottom + 1, left : right + 1]
    return _Sight(
        # one side may be hidden by the body, but neither may be cut off
        tuple(bool(inside[part].all() and visible[part].any()) for part in parts),
        float((high - low).max()),
        float(np.median(box)) if box.size else 0.0,
    )


def _camera_faults(title: str, pictures: Sequence[_Sight | None]) -> list[Finding]:
    """Return the first fault of a camera's pictures."""
    sights = [sight for sight in pictures if sight is not None]
    if len(sights) < _LIMITS.shown * len(pictures) or not sights:
        text = f"{title} shows nobody in {_percent(len(pictures) - len(sights), len(pictures))} of the pictures"
        advice = "stand where all cameras see you, with more light, and in clothes unlike the background"
        return [Finding(PersonFault.NOBODY, title, f"{text}: {advice}")]
    if (level := np.median([sight.level for sight in sights])) < _LIMITS.dark:
        text = f"{title} shows you too dark ({level:.0f} of 255 grey levels)"
        return [Finding(PersonFault.DARK, title, f"{text}: turn on more light, or let the camera choose the exposure")]
    if (extent := np.median([sight.extent_px for sight in sights])) < _LIMITS.least_px:
        text = f"{title} shows you only {extent:.0f} pixels tall"
        return [Finding(PersonFault.SMALL, title, f"{text}: come nearer, or choose a larger image size")]
    for index, part in enumerate(_PARTS):
        seen = sum(sight.parts[index] for sight in sights)
        if seen < _LIMITS.shown * len(sights):
            text = f"{title} does not see your {part} in {_percent(len(sights) - seen, len(sights))} of the pictures"
            return [Finding(PersonFault.CUT_OFF, title, f"{text}: step back, or turn the camera to show all of you")]
    return []


def _rig_faults(rig: CameraRig, frames: Sequence[MarkerFrame]) -> list[Finding]:
    """Return a finding if the cameras contradict each other, or look from nearly the same or opposite directions."""
    apart = sum(APART in frame.notes for frame in frames)
    if apart > (1.0 - _LIMITS.shown) * len(frames):
        return [Finding(PersonFault.APART, "", f"in {_percent(apart, len(frames))} of the pictures {APART}")]
    located = [np.median(frame.points_m, axis=0) for frame in frames if len(frame.points_m)]
    if not located:
        return []
    towards = np.median(located, axis=0) - np.array([camera.centre_m for camera in rig.cameras])
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    angles_deg = [float(np.degrees(np.arccos(np.clip(a @ b, -1.0, 1.0)))) for a, b in combinations(towards, 2)]
    low, high = _LIMITS.angles_deg
    if angles_deg and not any(low <= angle <= high for angle in angles_deg):
        text = f"seen from you, the cameras are {max(angles_deg):.0f} degrees apart"
        return [
            Finding(PersonFault.ANGLE, "", f"{text}: move one of them, 70 to 110 degrees are best; calibrate again")
        ]
    return []


def _percent(count: int, of: int) -> str:
    return f"{100.0 * count / max(of, 1):.0f} %"
