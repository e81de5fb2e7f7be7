"""Faults of single cameras: light, focus, shutter, reflections."""

from collections.abc import Sequence

import numpy as np

from ...geometry.arrays import Array, IntArray
from ...vision.detection.background import Background
from .finding import Fault, Finding
from .spots import Spots

_BRIGHT_ROOM = 110.0  # grey levels of half of the empty image: reflectors hardly rise above it
_SATURATED, _MOST_SATURATED = 250.0, 0.06  # grey levels, share of the empty image
_DIM_MARKER = 110.0  # grey levels: a marker this dim is lost when it turns or moves away
_SMALL_RISE = 50.0  # grey levels of a marker smaller than two pixels; of a dim one less
_SMALL_PX = 1.4  # radius, below which a spot has no edge
_TINY_PX = 1.15  # radius, below which it has no streak either: noise would count as one of 40 ms
_MOST_EMPTY = 0.5  # share of the images with hardly any spots, up to which markers are judged
_BLUNT_PX = 3.2  # width of an edge; a sharp one has about 2
_STILL_PX_S = 40.0
_FAST_PX_S = 120.0
_BRISK_PX_S = 80.0  # of a performer who never moves faster: a streak of 14 ms is still longer than a pixel
_FEWEST_FAST = 15
_LONG_S = 0.009  # of exposure: 3 cm at 3 m/s
_STREAK_PX = 1.0  # motion during the exposure that shows
_UNMOVED_PX = 0.7
_MOVING_PX_S = 60.0  # median of the spots in an image in which the performer moves
_FEWEST_MOVING = 15  # images: half a second at 30 Hz
_ALWAYS = 0.85  # share of these in which a still spot is seen; a foot stands for half of them at most


def room_faults(camera: str, background: Background) -> list[Finding]:
    """Return a finding on an empty room that is too bright."""
    level = background.mean.max(axis=2)
    saturated = float(np.mean(level > _SATURATED))
    if float(np.median(level)) > _BRIGHT_ROOM or saturated > _MOST_SATURATED:
        text = f"{camera} is too bright: the room has {np.median(level):.0f} of 255 grey levels"
        return [Finding(Fault.BRIGHT, camera, f"{text}; use a shorter exposure, or dim the room")]
    return []


def marker_light_faults(camera: str, spots: Spots, rises: Sequence[float], images: int) -> list[Finding]:
    """Return findings on markers that are too dim or too small.

    Args:
        rises: of images with hardly any spots, how far their brightest pixels are above the empty room, grey levels.
        images: number of all.
    """
    is_empty = len(rises) > _MOST_EMPTY * images
    usual = 0.0 if is_empty else float(np.percentile(spots.brightness, 80.0))
    if usual >= _DIM_MARKER:
        return []
    # markers smaller than pixels are dim as well
    if float(np.median(rises)) > _SMALL_RISE if is_empty else float(np.median(spots.radius_px)) < _SMALL_PX:
        text = f"you are too far away from {camera}: markers are smaller than three pixels"
        return [Finding(Fault.FAR, camera, f"{text}; come nearer, or use larger markers or images")]
    text = f"{camera} is too dark: " + (
        f"markers have {usual:.0f} of 255 grey levels" if usual else "no markers are seen"
    )
    return [Finding(Fault.DARK, camera, f"{text}; put the lamp nearer to the lens, or expose longer")]


def sharpness_faults(camera: str, spots: Spots) -> list[Finding]:
    """Return findings on focus and shutter of a camera."""
    radius_px = float(np.median(spots.radius_px)) if len(spots.radius_px) else 0.0
    slow = spots.speed_px_s < _STILL_PX_S
    edges = spots.edge_px[slow & np.isfinite(spots.edge_px)]
    if radius_px >= _SMALL_PX and len(edges) and float(np.median(edges)) > _BLUNT_PX:
        text = f"{camera} is out of focus: the edges of markers are {np.median(edges):.0f} pixels wide"
        return [Finding(Fault.BLURRED, camera, f"{text}; focus on the performer, switch automatic focus off")]
    exposure_s = estimate_exposure_s(spots) if radius_px >= _TINY_PX else 0.0
    if exposure_s > _LONG_S:
        text = f"the shutter of {camera} is too slow: it is open for about {1000.0 * exposure_s:.0f} ms"
        return [Finding(Fault.SHUTTER, camera, f"{text} and smears markers; set an exposure of 4 ms or less")]
    return []


def estimate_exposure_s(spots: Spots) -> float:
    """Return the exposure time by the streaks of moving markers; 0 if unknown.

    A motion of length s adds s^2 / 12 to the second moment along it.
    """
    measured = np.isfinite(spots.spread_px2[:, 0, 0])
    fast = measured & (spots.speed_px_s > _FAST_PX_S)
    if np.sum(fast) < _FEWEST_FAST:
        fast = measured & (spots.speed_px_s > _BRISK_PX_S)
    if np.sum(fast) < _FEWEST_FAST:
        return 0.0
    speed = spots.speed_px_s[fast]
    along = spots.velocity_px_s[fast] / speed[:, None]
    across = along[:, ::-1] * np.array([-1.0, 1.0])
    spread = spots.spread_px2[fast]
    added = np.einsum("ni,nij,nj->n", along, spread, along) - np.einsum("ni,nij,nj->n", across, spread, across)
    streaks_px = np.sqrt(12.0 * np.maximum(added, 0.0))
    if float(np.percentile(streaks_px, 75.0)) < _STREAK_PX:
        return 0.0
    return float(np.median(streaks_px / speed))


def moving_images(cameras: Sequence[Spots]) -> IntArray:
    """Return images (K,) with a moving performer, by any camera.

    Of a camera with still reflections the others know better.
    """
    found: set[int] = set()
    for spots in cameras:
        known = np.isfinite(spots.speed_px_s)
        for number in np.unique(spots.images[known]).tolist():
            if np.median(spots.speed_px_s[known & (spots.images == number)]) > _MOVING_PX_S:
                found.add(number)
    return np.array(sorted(found), dtype=np.int64)


def reflections(index: int, camera: str, spots: Spots, moving: IntArray) -> list[Finding]:
    """Return a finding on spots that stay where they are while the performer moves.

    Args:
        moving: images in which that is so.
    """
    still = _still_places(spots, moving)
    if not len(still):
        return []
    count = "a bright spot that is no marker" if len(still) == 1 else f"{len(still)} bright spots that are no markers"
    text = f"{camera} sees {count}: cover what reflects the light, or ignore the place"
    return [Finding(Fault.REFLECTION, camera, text, tuple((index, float(x), float(y)) for x, y in still))]


def _still_places(spots: Spots, moving: IntArray) -> Array:
    """Return places (K, 2) that hold a spot in almost all images with motion."""
    taking_part = np.isin(spots.images, moving)
    images, pixels = spots.images[taking_part], spots.pixels[taking_part]
    places: list[Array] = []
    for pixel in pixels if len(moving) >= _FEWEST_MOVING else ():
        if places and np.linalg.norm(np.array(places) - pixel, axis=1).min() < 4.0 * _UNMOVED_PX:
            continue
        near = np.linalg.norm(pixels - pixel, axis=1) < _UNMOVED_PX
        if len(np.unique(images[near])) >= _ALWAYS * len(moving):
            places.append(pixels[near].mean(axis=0))
    return np.array(places).reshape(-1, 2)
