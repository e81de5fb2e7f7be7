"""Image source of markers that lie on the floor in front of the simulated cameras."""

from collections.abc import Iterator

import numpy as np

from ...body.motion import Motion
from ...body.standard_skeleton import default_skeleton
from ...geometry.arrays import Image
from ...geometry.camera import CameraRig
from ...vision.sources.image_set import ClosableSource
from .filmed_motion import make_performance
from .render import Renderer, StudioFrame
from .studio_rig import FPS
from .studio_settings import StudioSettings

SETTINGS = StudioSettings(draw_body=False, occlusion=False)
PLACES_M = np.array([[-0.5, 0.85], [0.45, 0.9], [0.5, 0.35], [-0.45, 0.3]])  # positions on the floor, x and z


class FloorMarkers(ClosableSource):
    """Four markers on the floor of an empty room, seen by all cameras."""

    def __init__(self, rig: CameraRig) -> None:
        self.fps = FPS
        self._renderer = Renderer(rig, SETTINGS)
        skeleton = default_skeleton()
        nobody = Motion("nobody", FPS, skeleton, np.tile([1.0, 0.0, 0.0, 0.0], (2, len(skeleton), 1)), np.zeros((2, 3)))
        places = np.insert(PLACES_M, 1, SETTINGS.marker_radius_m, axis=1)
        names = tuple(f"M{number:02d}" for number in range(1, len(places) + 1))
        self._performance = make_performance(nobody, names, np.zeros(len(places), dtype=np.int64), places)

    def background_frames(self, count: int) -> Iterator[tuple[Image, ...]]:
        """Yield images of the empty room, one per camera."""
        for number in range(count):
            yield self._renderer.background(number)

    def __iter__(self) -> Iterator[StudioFrame]:
        """Yield image sets for three seconds, or until `close`."""
        for number in range(round(3.0 * self.fps)):
            if self._closed:
                return
            yield self._renderer.render(self._performance, number / self.fps, number)
