"""Faults of single cameras: light, focus, shutter, reflections."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...geometry.arrays import Array, IntArray
from ...vision.detection.background import Background
from .finding import Fault, Finding
from .spots import Spots


@dataclass(frozen=True)
class ImageLimits:
    """Limits that pictures without faults meet."""

    bright_room: float = 110.0  # median grey level of the background above which reflectors hardly stand out
    saturated: float = 250.0  # grey level that counts as saturated
    most_saturated: float = 0.06  # largest share of saturated pixels in the background
    dim_marker: float = 110.0  # grey level of markers below which they are lost when they turn or move away
    small_rise: float = 50.0  # contrast of a bright marker smaller than two pixels, grey levels; dim ones have less
    small_px: float = 1.4  # radius below which the edge of a blob cannot be measured
    tiny_px: float = 1.15  # radius below which a streak cannot be measured: noise looks like 40 ms of exposure
    most_empty: float = 0.5  # share of images with hardly any blobs above which no markers are measured
    blunt_px: float = 3.2  # edge width above which the image is blurred; a sharp edge has about 2
    still_px_s: float = 40.0
    # speed above which a marker is fast; the second applies if few exceed the first
    fast_px_s: tuple[float, float] = (120.0, 80.0)
    fewest_fast: int = 15
    long_s: float = 0.009  # exposure above which the shutter is too slow: 3 cm at 3 m/s
    streak_px: float = 1.0  # shortest streak that is measured
    unmoved_px: float = 0.7
    moving_px_s: float = 60.0  # median speed of blobs above which the performer is moving
    fewest_moving: int = 15  # fewest images with motion: half a second at 30 Hz
    always: float = 0.85  # share of these images in which a reflection appears; a foot is still in at most half


LIMITS = ImageLimits()


def room_faults(camera: str, background: Background) -> list[Finding]:
    """Return a finding if the background is too bright."""
    level = background.mean.max(axis=2)
    saturated = float(np.mean(level > LIMITS.saturated))
    if float(np.median(level)) > LIMITS.bright_room or saturated > LIMITS.most_saturated:
        text = f"{camera} is too bright: the room has {np.median(level):.0f} of 255 grey levels"
        return [Finding(Fault.BRIGHT, camera, f"{text}; use a shorter exposure, or dim the room")]
    return []


def marker_light_faults(camera: str, spots: Spots, rises: Sequence[float], images: int) -> list[Finding]:
    """Return findings if markers are too dim or too small.

    Args:
        rises: Contrast of the brightest pixels to the background, grey levels, in each image with hardly any blobs.
        images: Number of images, including those.
    """
    is_empty = len(rises) > LIMITS.most_empty * images
    usual = 0.0 if is_empty else float(np.percentile(spots.brightness, 80.0))
    if usual >= LIMITS.dim_marker:
        return []
    # markers smaller than a pixel are also dim, but for another reason
    is_small = (
        float(np.median(rises)) > LIMITS.small_rise if is_empty else float(np.median(spots.radius_px)) < LIMITS.small_px
    )
    if is_small:
        text = f"you are too far away from {camera}: markers are smaller than three pixels"
        return [Finding(Fault.FAR, camera, f"{text}; come nearer, or use larger markers or images")]
    text = f"{camera} is too dark: " + (
        f"markers have {usual:.0f} of 255 grey levels" if usual else "no markers are seen"
    )
    return [Finding(Fault.DARK, camera, f"{text}; put the lamp nearer to the lens, or expose longer")]


def sharpness_faults(camera: str, spots: Spots) -> list[Finding]:
    """Return a finding if the camera is out of focus or its shutter too slow."""
    radius_px = float(np.median(spots.radius_px)) if len(spots.radius_px) else 0.0
    slow = spots.speed_px_s < LIMITS.still_px_s
    edges = spots.edge_px[slow & np.isfinite(spots.edge_px)]
    if radius_px >= LIMITS.small_px and len(edges) and float(np.median(edges)) > LIMITS.blunt_px:
        text = f"{camera} is out of focus: the edges of markers are {np.median(edges):.0f} pixels wide"
        return [Finding(Fault.BLURRED, camera, f"{text}; focus on the performer, switch automatic focus off")]
    exposure_s = estimate_exposure_s(spots) if radius_px >= LIMITS.tiny_px else 0.0
    if exposure_s > LIMITS.long_s:
        text = f"the shutter of {camera} is too slow: it is open for about {1000.0 * exposure_s:.0f} ms"
        return [Finding(Fault.SHUTTER, camera, f"{text} and smears markers; set an exposure of 4 ms or less")]
    return []


def estimate_exposure_s(spots: Spots) -> float:
    """Return the exposure time from the streaks of moving markers, 0 if unknown.

    A streak of length s adds s^2 / 12 to the second moment along the motion.
    """
    measured = np.isfinite(spots.spread_px2[:, 0, 0])
    for least_px_s in LIMITS.fast_px_s:
        fast = measured & (spots.speed_px_s > least_px_s)
        if np.sum(fast) >= LIMITS.fewest_fast:
            break
    else:
        return 0.0
    speed = spots.speed_px_s[fast]
    along = spots.velocity_px_s[fast] / speed[:, None]
    across = along[:, ::-1] * np.array([-1.0, 1.0])
    spread = spots.spread_px2[fast]
    added = np.einsum("ni,nij,nj->n", along, spread, along) - np.einsum("ni,nij,nj->n", across, spread, across)
    streaks_px = np.sqrt(12.0 * np.maximum(added, 0.0))
    if float(np.percentile(streaks_px, 75.0)) < LIMITS.streak_px:
        return 0.0
    return float(np.median(streaks_px / speed))


def moving_images(cameras: Sequence[Spots]) -> IntArray:
    """Return the indices (K,) of the images in which any camera sees the performer move.

    Reflections may hide the motion from one camera.
    """
    found: set[int] = set()
    for spots in cameras:
        known = np.isfinite(spots.speed_px_s)
        for number in np.unique(spots.images[known]).tolist():
            if np.median(spots.speed_px_s[known & (spots.images == number)]) > LIMITS.moving_px_s:
                found.add(number)
    return np.array(sorted(found), dtype=np.int64)


def reflections(index: int, camera: str, spots: Spots, moving: IntArray) -> list[Finding]:
    """Return a finding on blobs that stay in place in the images `moving`, in which the performer moves."""
    still = _still_places(spots, moving)
    if not len(still):
        return []
    count = "a bright spot that stays" if len(still) == 1 else f"{len(still)} bright spots that stay"
    text = f"{camera} sees {count} in place: cover what reflects the light, or ignore the place"
    return [Finding(Fault.REFLECTION, camera, text, tuple((index, float(x), float(y)) for x, y in still))]


def _still_places(spots: Spots, moving: IntArray) -> Array:
    """Return the positions (K, 2) at which almost all images `moving` have a blob."""
    taking_part = np.isin(spots.images, moving)
    images, pixels = spots.images[taking_part], spots.pixels[taking_part]
    places: list[Array] = []
    for pixel in pixels if len(moving) >= LIMITS.fewest_moving else ():
        if places and np.linalg.norm(np.array(places) - pixel, axis=1).min() < 4.0 * LIMITS.unmoved_px:
            continue
        near = np.linalg.norm(pixels - pixel, axis=1) < LIMITS.unmoved_px
        if len(np.unique(images[near])) >= LIMITS.always * len(moving):
            places.append(pixels[near].mean(axis=0))
    return np.array(places).reshape(-1, 2)
