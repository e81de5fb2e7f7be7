"""Images of the simulated cameras: room, body, markers, noise, and their truth."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
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

_NOISE_SPARE = 160  # the noise table is this much larger than the image each way, so that it can be shifted
_MAX_BLUR_STEPS = 24


@dataclass(frozen=True)
class FrameTruth:
    """Truth of one set of images.

    Args:
        time_s: time of the frame from the performance's start, seconds.
        markers_m: (M, 3) marker centres at that time, world metres.
        pixels: (C, M, 2) marker centres in each image, at the middle of that camera's exposure.
        radii_px: (C, M) radii of the discs.
        visible: (C, M) which markers each image shows.
        ghosts: per camera (G, 2) centres of the false blobs drawn.
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
    """Images of all cameras, and the truth."""

    truth: FrameTruth = field(kw_only=True)


@dataclass(frozen=True)
class _Sight:
    """Markers in one image: path (M, S, 2), centres (M, 2), radii, depth, seen (M,)."""

    paths: Array
    centres: Array
    radii: Array
    depth: Array
    seen: Mask


@dataclass(frozen=True)
class _Ghost:
    """A false blob: centre (2,) and radius in pixels, BGR colour."""

    centre: Array
    radius: float
    colour: Array


class Renderer:
    """The cameras of a rig in the simulated room."""

    def __init__(self, rig: CameraRig, settings: StudioSettings | None = None) -> None:
        self.rig = rig
        self.settings = settings or StudioSettings()
        furniture = FURNITURE if self.settings.clutter else ()
        views = _views(rig, furniture)
        self._lit = tuple(view.image(1.0) for view in views)
        self._empty = tuple(view.image(self.settings.light) for view in views)
        self._rooms = self._empty
        if self.settings.moved_object:
            views = _views(rig, (*furniture, MOVED_OBJECT))
            self._rooms = tuple(view.image(self.settings.light) for view in views)
        self._noise = _noise_tables(rig, self.settings)

    def background(self, number: int) -> tuple[Image, ...]:
        """Return images of the empty room with fresh noise, one per camera."""
        images = tuple(image.copy() for image in self._empty)
        for i, image in enumerate(images):
            self.add_noise(image, i, -1 - number)
        return images

    def lit_room(self, camera: int) -> Image:
        """Return the empty room without noise at full light, as for pictures of the board."""
        return self._lit[camera].copy()

    def render(self, performance: Performance, time_s: float, number: int) -> StudioFrame:
        """Return the images of all cameras at a time, seconds, with their truth.

        The same number and seed give the same noise.
        """
        times = self._times(time_s)
        sights = self._sights(performance, times, number)
        images = []
        for i, (camera, time, sight) in enumerate(zip(self.rig.cameras, times, sights, strict=True)):
            image = self._room(i, time)
            if self.settings.draw_body:
                for one, cones in _from_afar(camera, performance, time):
                    draw_body(image, camera, one.body, cones, self.settings.light)
            for ghost in self._ghosts(i, time):
                draw_disc(image, ghost.centre[None], ghost.radius, ghost.colour, self.settings.lens_blur_px)
            self._draw_markers(image, sight)
            self.add_noise(image, i, number)
            images.append(image)
        truth = self._truth(performance, time_s, number, sights)
        return StudioFrame(number, tuple(times), tuple(images), truth=truth)

    def _times(self, time_s: float) -> list[float]:
        return [time_s + self.settings.time_offset_s(i) for i in range(len(self.rig))]

    def _sights(self, performance: Performance, times: list[float], number: int) -> list[_Sight]:
        rows = enumerate(zip(self.rig.cameras, times, strict=True))
        return [self._sight(camera, performance, time, number, i) for i, (camera, time) in rows]

    def _truth(self, performance: Performance, time_s: float, number: int, sights: list[_Sight]) -> FrameTruth:
        ghosts = [[g.centre for g in self._ghosts(i, time)] for i, time in enumerate(self._times(time_s))]
        return FrameTruth(
            number=number,
            time_s=time_s,
            markers_m=performance.markers_at([time_s])[0],
            pixels=np.array([sight.centres for sight in sights]),
            radii_px=np.array([sight.radii for sight in sights]),
            visible=np.array([sight.seen for sight in sights]),
            ghosts=tuple(np.array(centres).reshape(-1, 2) for centres in ghosts),
        )

    def add_noise(self, image: Image, camera: int, number: int) -> None:
        """Add this camera's sensor noise of frame `number` to an image, in place."""
        if self._noise is None:
            return
        rng = np.random.default_rng([self.settings.seed, camera, number & 0xFFFFFFFF])
        height, width = image.shape[:2]
        up, down = self._noise
        y, x = rng.integers(0, up.shape[0] - height + 1), rng.integers(0, up.shape[1] - width + 1)
        cv2.add(image, up[y : y + height, x : x + width], dst=image)
        cv2.subtract(image, down[y : y + height, x : x + width], dst=image)

    def _room(self, camera: int, time_s: float) -> Image:
        room = self._rooms[camera]
        if self.settings.light_drift == 0.0:
            return room.copy()
        factor = 1.0 + self.settings.light_drift * float(np.sin(0.5 * time_s))
        return np.asarray(cv2.convertScaleAbs(room, alpha=factor), dtype=np.uint8)

    def _sight(self, camera: Camera, performance: Performance, time: float, number: int, index: int) -> _Sight:
        settings = self.settings
        count = sum(one.markers_m.shape[1] for one in performance.everybody)
        middles = np.full(count, time)
        if settings.rolling_shutter_s > 0.0:
            rows = np.nan_to_num(camera.project(performance.markers_at([time])[0])[:, 1])
            middles = time + (rows / camera.image_size[1] - 0.5) * settings.rolling_shutter_s
        centres_m = _own_times(performance, middles[:, None])[:, 0]
        depth = camera.to_camera(centres_m)[:, 2]
        radii = camera.focal_px * settings.marker_radius_m / np.maximum(depth, 0.05)
        centres = camera.project(centres_m)
        seen = _inside(camera, centres)
        if settings.occlusion:
            for _, cones in _from_afar(camera, performance, time):
                seen &= visible(camera.centre_m, centres_m, cones, 0.5 * settings.marker_radius_m)
            seen &= ~_behind_another(centres, radii, depth)
        if settings.dropout > 0.0:
            rng = np.random.default_rng([settings.seed, index, number, 1])
            seen &= rng.random(count) >= settings.dropout
        paths = centres[:, None]
        if settings.exposure_s > 0.0:
            paths = self._smeared(camera, performance, middles)
        return _Sight(paths, centres, radii, depth, seen)

    def _smeared(self, camera: Camera, performance: Performance, middles: Array) -> Array:
        """Return pixels (M, S, 2) at S moments of the exposure, two to a smeared pixel."""
        half = 0.5 * self.settings.exposure_s
        ends = camera.project(_own_times(performance, middles[:, None] + np.array([-half, half])))
        longest = float(np.nanmax(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=-1), initial=0.0))
        steps = int(np.clip(np.ceil(2.0 * longest), 1, _MAX_BLUR_STEPS))
        moments = ((np.arange(steps) + 0.5) / steps * 2.0 - 1.0) * half
        return camera.project(_own_times(performance, middles[:, None] + moments))

    def _draw_markers(self, image: Image, sight: _Sight) -> None:
        for marker in np.argsort(-sight.depth):
            if sight.seen[marker]:
                colour = np.full(3, self.settings.marker_brightness)
                if marker < len(self.settings.marker_colours):
                    colour = np.array(self.settings.marker_colours[marker])
                draw_disc(image, sight.paths[marker], float(sight.radii[marker]), colour, self.settings.lens_blur_px)

    def _ghosts(self, camera: int, time_s: float) -> list[_Ghost]:
        """Blobs that wander on slow curves and go out now and then."""
        shown = []
        size = np.array(self.rig.cameras[camera].image_size, dtype=np.float64)
        for ghost in range(self.settings.ghosts):
            rng = np.random.default_rng([self.settings.seed, camera, ghost, 2])
            middle, sway = rng.uniform(0.2, 0.8, 2), rng.uniform(0.03, 0.15, 2)
            rate, phase = rng.uniform(0.4, 1.5, 2), rng.uniform(0.0, 6.28, 2)
            radius, brightness = float(rng.uniform(1.3, 2.8)), rng.uniform(200.0, 250.0)
            if np.sin(0.7 * rate[0] * time_s + phase[1]) > -0.4:
                centre = size * (middle + sway * np.sin(rate * time_s + phase))
                shown.append(_Ghost(centre, radius, np.full(3, brightness)))
        return shown


def _from_afar(camera: Camera, performance: Performance, time: float) -> list[tuple[Performance, RoundCones]]:
    """Everybody with their bodies at a time, those far from the camera first."""
    placed = [(one, one.cones_at(time)) for one in performance.everybody]
    return sorted(placed, key=lambda pair: -float(camera.to_camera(pair[1].starts)[:, 2].mean()))


def _own_times(performance: Performance, times: Array) -> Array:
    """World positions (M, S, 3) of every marker at its own times (M, S)."""
    count, steps = times.shape
    if np.all(times == times[0]):
        return np.swapaxes(performance.markers_at(times[0]), 0, 1)
    every = performance.markers_at(times.ravel()).reshape(count, steps, count, 3)
    own = np.arange(count)
    return every[own, :, own]


def _inside(camera: Camera, pixels: Array) -> Mask:
    width, height = camera.image_size
    x, y = pixels[:, 0], pixels[:, 1]
    with np.errstate(invalid="ignore"):
        inside: Mask = (x > -0.5) & (y > -0.5) & (x < width - 0.5) & (y < height - 0.5)
    return inside


def _behind_another(centres: Array, radii: Array, depth: Array) -> Mask:
    """Return (M,) bool: markers with their centre behind a nearer marker's ball."""
    apart = np.linalg.norm(np.nan_to_num(centres)[:, None] - np.nan_to_num(centres), axis=-1)
    return np.asarray(np.any((apart < radii) & (depth < depth[:, None]), axis=1))


def _views(rig: CameraRig, boxes: tuple[Box, ...]) -> tuple[RoomView, ...]:
    """Draw the room for all cameras in parallel, the slowest part before the start."""
    with ThreadPoolExecutor(len(rig)) as pool:
        return tuple(pool.map(view_room, rig.cameras, repeat(boxes)))


def _noise_tables(rig: CameraRig, settings: StudioSettings) -> tuple[Image, Image] | None:
    """Return noise to add and to subtract, larger than the largest image."""
    if settings.noise_sigma == 0.0:
        return None
    rng = np.random.default_rng([settings.seed, 3])
    width = max(camera.image_size[0] for camera in rig.cameras) + _NOISE_SPARE
    height = max(camera.image_size[1] for camera in rig.cameras) + _NOISE_SPARE
    noise = np.rint(rng.standard_normal((height, width, 3), dtype=np.float32) * np.float32(settings.noise_sigma))
    up = np.clip(noise, 0, 255).astype(np.uint8)
    down = np.clip(-noise, 0, 255).astype(np.uint8)
    return up, down
