"""Images of the simulated cameras with room, body, markers and noise, and their ground truth."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import repeat

import cv2
import numpy as np

from ...geometry.arrays import Array, Image, Mask
from ...geometry.camera import Camera, CameraRig
from ...vision.sources.image_set import ImageSet
from .cones import RoundCones, visible
from .discs import draw_disc
from .filmed_motion import Performance
from .limb_outlines import draw_body
from .room import FURNITURE, MOVED_OBJECT, Box, RoomView, view_room
from .studio_settings import StudioSettings


@dataclass(frozen=True)
class FrameTruth:
    """Ground truth of one image set.

    Args:
        time_s: Time since the start of the performance.
        markers_m: Marker centres (M, 3) at that time in world axes.
        pixels: Marker centres (C, M, 2) in each image, at the middle of that camera's exposure.
        radii_px: Radii (C, M) of the discs.
        visible: Mask (C, M) of the markers that each image shows.
        ghosts: Centres (G, 2) of the false blobs in each image.
    """

    number: int
    time_s: float
    markers_m: Array
    pixels: Array
    radii_px: Array
    visible: Mask
    ghosts: tuple[Array, ...]


@dataclass(frozen=True)
class StudioFrame(ImageSet):
    """Images of all cameras (BGR, uint8), and their ground truth."""

    truth: FrameTruth = field(kw_only=True)


_Bodies = list[tuple[Performance, RoundCones]]


@dataclass(frozen=True)
class _ImagedMarkers:
    """Markers in one image: paths (M, S, 2) during the exposure, centres (M, 2), radii, depths and visibility (M,)."""

    paths: Array
    centres: Array
    radii: Array
    depth: Array
    seen: Mask


class Renderer:
    """Renderer of the images that a rig's cameras take in the simulated room."""

    def __init__(self, rig: CameraRig, settings: StudioSettings | None = None) -> None:
        self.rig = rig
        self.settings = settings or StudioSettings()
        furniture = FURNITURE if self.settings.clutter else ()
        views = _views(rig, furniture)
        self._lit = tuple(view.image(1.0) for view in views)
        self._empty = self._rooms = tuple(view.image(self.settings.light) for view in views)
        if self.settings.moved_object:
            views = _views(rig, (*furniture, MOVED_OBJECT))
            self._rooms = tuple(view.image(self.settings.light) for view in views)
        sizes = tuple(camera.image_size for camera in rig.cameras)
        self._noise = _noise_tables(sizes, self.settings.noise_sigma, self.settings.seed)

    def background(self, number: int) -> tuple[Image, ...]:
        """Return images of the empty room with fresh noise, one per camera."""
        images = tuple(image.copy() for image in self._empty)
        for i, image in enumerate(images):
            self.add_noise(image, i, -1 - number)
        return images

    def lit_room(self, camera: int) -> Image:
        """Return the empty room without noise at full light, as in pictures of the board."""
        return self._lit[camera].copy()

    def render(self, performance: Performance, time_s: float, number: int) -> StudioFrame:
        """Return the images of all cameras at a time, with their ground truth.

        The same number and seed give the same noise.
        """
        times = tuple(time_s + self.settings.time_offset_s(i) for i in range(len(self.rig)))
        images, all_ghosts, imaged = [], [], []
        for i, (camera, time) in enumerate(zip(self.rig.cameras, times, strict=True)):
            bodies = _from_afar(camera, performance, time)
            markers, ghosts = self._imaged_markers(performance, bodies, time, number, i), self._ghosts(i, time)
            image = self._room(i, time)
            if self.settings.draw_body:
                for one, cones in bodies:
                    draw_body(image, camera, one.body, cones, self.settings.light)
            for centre, radius, brightness in ghosts:
                draw_disc(image, centre[None], radius, np.full(3, brightness), self.settings.lens_blur_px)
            self._draw_markers(image, markers)
            self.add_noise(image, i, number)
            images.append(image)
            imaged.append(markers)
            all_ghosts.append(np.array([centre for centre, _, _ in ghosts]).reshape(-1, 2))
        truth = FrameTruth(
            number=number,
            time_s=time_s,
            markers_m=performance.markers_at([time_s])[0],
            pixels=np.array([markers.centres for markers in imaged]),
            radii_px=np.array([markers.radii for markers in imaged]),
            visible=np.array([markers.seen for markers in imaged]),
            ghosts=tuple(all_ghosts),
        )
        return StudioFrame(number, times, tuple(images), truth=truth)

    def add_noise(self, image: Image, camera: int, number: int) -> None:
        """Add the sensor noise of one camera and frame to an image, in place."""
        if self._noise is None:
            return
        rng = np.random.default_rng([self.settings.seed, camera, number & 0xFFFFFFFF])
        height, width = image.shape[:2]
        up, down = self._noise
        y, x = rng.integers(0, up.shape[0] - height + 1), rng.integers(0, up.shape[1] - width + 1)
        cv2.add(image, up[y : y + height, x : x + width], dst=image)
        cv2.subtract(image, down[y : y + height, x : x + width], dst=image)

    def _room(self, camera: int, time_s: float) -> Image:
        factor = 1.0 + self.settings.light_drift * float(np.sin(0.5 * time_s))
        return np.asarray(cv2.convertScaleAbs(self._rooms[camera], alpha=factor), dtype=np.uint8)

    def _imaged_markers(
        self, performance: Performance, bodies: _Bodies, time: float, number: int, index: int
    ) -> _ImagedMarkers:
        camera, settings = self.rig.cameras[index], self.settings
        count = sum(one.markers_m.shape[1] for one in performance.everybody)
        middles = np.full(count, time)
        if settings.rolling_shutter_s > 0.0:
            rows = np.nan_to_num(camera.project(performance.markers_at([time])[0])[:, 1])
            middles = time + (rows / camera.image_size[1] - 0.5) * settings.rolling_shutter_s
        centres_m = _own_times(performance, middles[:, None])[:, 0]
        depth = camera.to_camera(centres_m)[:, 2]
        radii = camera.focal_px * settings.marker_radius_m / np.maximum(depth, 0.05)
        centres = camera.project(centres_m)
        with np.errstate(invalid="ignore"):
            seen = np.all((centres > -0.5) & (centres < np.array(camera.image_size) - 0.5), axis=1)
        if settings.occlusion:
            for _, cones in bodies:
                seen &= visible(camera.centre_m, centres_m, cones, 0.5 * settings.marker_radius_m)
            seen &= ~_behind_another(centres, radii, depth)
        if settings.dropout > 0.0:
            rng = np.random.default_rng([settings.seed, index, number, 1])
            seen &= rng.random(count) >= settings.dropout
        paths = self._smeared(camera, performance, middles) if settings.exposure_s > 0.0 else centres[:, None]
        return _ImagedMarkers(paths, centres, radii, depth, seen)

    def _smeared(self, camera: Camera, performance: Performance, middles: Array) -> Array:
        """Return the markers' pixels (M, S, 2) at S moments of the exposure, two per pixel of motion."""
        half = 0.5 * self.settings.exposure_s
        ends = camera.project(_own_times(performance, middles[:, None] + np.array([-half, half])))
        longest = float(np.nanmax(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=-1), initial=0.0))
        steps = int(np.clip(np.ceil(2.0 * longest), 1, 24))
        moments = ((np.arange(steps) + 0.5) / steps * 2.0 - 1.0) * half
        return camera.project(_own_times(performance, middles[:, None] + moments))

    def _draw_markers(self, image: Image, markers: _ImagedMarkers) -> None:
        for marker in np.argsort(-markers.depth):
            if markers.seen[marker]:
                colour = np.full(3, self.settings.marker_brightness)
                if marker < len(self.settings.marker_colours):
                    colour = np.array(self.settings.marker_colours[marker])
                path, radius = markers.paths[marker], float(markers.radii[marker])
                draw_disc(image, path, radius, colour, self.settings.lens_blur_px)

    def _ghosts(self, camera: int, time_s: float) -> list[tuple[Array, float, float]]:
        """Return centre, radius and brightness of false blobs that wander slowly and disappear from time to time."""
        shown = []
        size = np.array(self.rig.cameras[camera].image_size, dtype=np.float64)
        for ghost in range(self.settings.ghosts):
            rng = np.random.default_rng([self.settings.seed, camera, ghost, 2])
            middle, sway = rng.uniform(0.2, 0.8, 2), rng.uniform(0.03, 0.15, 2)
            rate, phase = rng.uniform(0.4, 1.5, 2), rng.uniform(0.0, 6.28, 2)
            radius, brightness = float(rng.uniform(1.3, 2.8)), float(rng.uniform(200.0, 250.0))
            if np.sin(0.7 * rate[0] * time_s + phase[1]) > -0.4:
                shown.append((size * (middle + sway * np.sin(rate * time_s + phase)), radius, brightness))
        return shown


def _from_afar(camera: Camera, performance: Performance, time: float) -> _Bodies:
    """Return all performers and their bodies at the given time, the farthest from the camera first."""
    placed = [(one, one.cones_at(time)) for one in performance.everybody]
    return sorted(placed, key=lambda pair: -float(camera.to_camera(pair[1].starts)[:, 2].mean()))


def _own_times(performance: Performance, times: Array) -> Array:
    """Return the world positions (M, S, 3) of markers, each at its own times (M, S)."""
    count, steps = times.shape
    if np.all(times == times[0]):
        return np.swapaxes(performance.markers_at(times[0]), 0, 1)
    every = performance.markers_at(times.ravel()).reshape(count, steps, count, 3)
    own = np.arange(count)
    return every[own, :, own]


def _behind_another(centres: Array, radii: Array, depth: Array) -> Mask:
    """Return a mask (M,) of the markers whose centre is hidden by a nearer marker."""
    apart = np.linalg.norm(np.nan_to_num(centres)[:, None] - np.nan_to_num(centres), axis=-1)
    return np.asarray(np.any((apart < radii) & (depth < depth[:, None]), axis=1))


def _views(rig: CameraRig, boxes: tuple[Box, ...]) -> tuple[RoomView, ...]:
    """Draw the room for all cameras, in parallel because this is the slowest part of opening a studio."""
    with ThreadPoolExecutor(len(rig)) as pool:
        return tuple(pool.map(view_room, rig.cameras, repeat(boxes)))


@lru_cache(maxsize=2)
def _noise_tables(sizes: tuple[tuple[int, int], ...], sigma: float, seed: int) -> tuple[Image, Image] | None:
    """Return a noise image to add and one to subtract, larger than any camera's image so that they can be shifted."""
    if sigma == 0.0:
        return None
    rng = np.random.default_rng([seed, 3])
    width, height = np.max(sizes, axis=0) + 160
    noise = np.rint(rng.standard_normal((height, width, 3), dtype=np.float32) * np.float32(sigma))
    return np.clip(noise, 0, 255).astype(np.uint8), np.clip(-noise, 0, 255).astype(np.uint8)
