"""Simulated performer as an image source, live or as fast as it is drawn."""

import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ...body.motion import Motion
from ...body.standard_skeleton import DEFAULT_HEIGHT_M, default_skeleton
from ...errors import SettingsError
from ...geometry.arrays import Image
from ...geometry.camera import CameraRig
from ...markers.marker_set import MarkerSet, load_marker_set
from ...markers.prop import load_prop
from ...markers.subject import Subject
from ...system.schema import Table
from ...vision.sources.image_set import ClosableSource
from ..shipped_performance import DEMO, performance, with_return
from .carried_prop import Carried, in_hand
from .filmed_motion import Performance, make_performance
from .render import Renderer, StudioFrame
from .simulated_performer import SIMULATED, SimulatedPerformer
from .stage_placement import with_poses
from .studio_rig import FPS, default_rig
from .studio_settings import StudioSettings

_AROUND_S = 4.0  # of a performance: T pose, arms down, and a rest at the end
_SPACING_M = 1.2  # between performers: both stay in the picture, and arms held out do not meet
_MOST_PARTNERS = 7  # no room holds more, and each takes a second to prepare
_RETURN_S = 1.5  # time in which a performer who starts again goes back to the first pose


@dataclass(eq=False)
class SimulatedSource(ClosableSource):
    """Image sets of a performance, with their truth.

    Iterate to take them; each has number, times_s and images.

    Args:
        subject: the performer's true skeleton and marker offsets.
        live: hand every frame over at its time on the clock, and leave out those that are late, as a camera does.
        loop: start again when the performance is over.

    Attributes:
        first: number of the first frame that is handed over; live all begin at 0.
    """

    performance: Performance
    subject: Subject
    renderer: Renderer
    fps: float = FPS
    live: bool = False
    loop: bool = False
    first: int = field(default=0, init=False)
    dropped: int = field(default=0, init=False)

    @property
    def rig(self) -> CameraRig:
        """The true cameras."""
        return self.renderer.rig

    @property
    def motion(self) -> Motion:
        """The true motion."""
        return self.performance.motion

    @property
    def frames(self) -> int:
        """Image sets in one run of the performance."""
        return int(np.floor(self.motion.duration_s * self.fps + 1e-6)) + 1

    def background_frames(self, count: int) -> Iterator[tuple[Image, ...]]:
        """Yield images of the empty room, one per camera, for learning the background."""
        for number in range(count):
            yield self.renderer.background(number)

    def frame(self, number: int) -> StudioFrame:
        """Return one image set by its number."""
        frame = self.renderer.render(self.performance, self._time(number), number)
        offset = number / self.fps - self._time(number)
        return replace(frame, times_s=tuple(t + offset for t in frame.times_s)) if offset else frame

    def __iter__(self) -> Iterator[StudioFrame]:
        """Yield image sets until the performance is over, or `close`."""
        start = time.perf_counter()
        number = 0 if self.live else self.first
        while not self._closed and (self.loop or number < self.frames):
            if self.live:
                late = int((time.perf_counter() - start) * self.fps)
                self.dropped += max(late - number, 0)
                number = max(number, late)
                if not self.loop and number >= self.frames:
                    return
                frame = self.frame(number)
                time.sleep(max(0.0, start + number / self.fps - time.perf_counter()))
            else:
                frame = self.frame(number)
            yield frame
            number += 1

    def _time(self, number: int) -> float:
        moment = number / self.fps
        return moment % (self.motion.duration_s + 1.0 / self.motion.fps) if self.loop else moment


def open_simulated(asked: SimulatedPerformer | Table) -> SimulatedSource:
    """Return the simulated performer as described.

    Raises:
        SettingsError: An unknown key, behaviour or setting.
        MarkerSetError: The marker set is unknown or has no offsets.
        PropError: The prop is unknown or unusable.
    """
    if not isinstance(asked, SimulatedPerformer):
        asked = SIMULATED.read({"kind": "simulated", **asked}, "simulated performer")
    if len(asked.partners) > _MOST_PARTNERS:
        raise SettingsError(
            f"{len(asked.partners)} partners of the simulated performer", advice=f"ask for {_MOST_PARTNERS} at most"
        )
    partners = [asked.partner(partner) for partner in asked.partners]
    places_m = _SPACING_M * (np.arange(1 + len(partners)) - 0.5 * len(partners))
    motions = [with_poses(_motion(one), asked.poses, asked.held_s) for one in (asked, *partners)]
    motion, *others = (
        replace(motion, root_positions_m=motion.root_positions_m + np.array([place_m, 0.0, 0.0]))
        for motion, place_m in zip(motions, places_m, strict=True)
    )
    carried = in_hand(load_prop(asked.prop)) if asked.prop else None
    return simulated_source(
        motion,
        asked.marker_set,
        Renderer(default_rig(asked.cameras), studio_settings(asked.studio)),
        fps=asked.fps,
        live=asked.live,
        loop=asked.live if asked.loop is None else asked.loop,
        extras=Extras(carried, tuple(zip(others, (one.marker_set for one in partners), strict=True))),
    )


@dataclass(frozen=True)
class Extras:
    """Prop of the first performer; motions and marker sets of further performers."""

    prop: Carried | None = None
    partners: tuple[tuple[Motion, str], ...] = ()


def simulated_source(
    motion: Motion,
    marker_set: str,
    renderer: Renderer,
    *,
    fps: float = FPS,
    live: bool = False,
    loop: bool = False,
    extras: Extras | None = None,
) -> SimulatedSource:
    """Return an image source of a motion performed with a marker set, and a prop.

    The marker set (name or file) has offsets.
    """
    subject = Subject("simulated performer", motion.skeleton, load_marker_set(marker_set))
    extras = extras or Extras()
    everybody = [_performed(motion, subject.marker_set, loop, extras.prop)]
    everybody += [_performed(other, load_marker_set(worn), loop) for other, worn in extras.partners]
    performance = replace(everybody[0], partners=tuple(everybody[1:]))
    return SimulatedSource(performance, subject, renderer, fps=fps, live=live, loop=loop)


def _performed(motion: Motion, markers: MarkerSet, loop: bool, carried: Carried | None = None) -> Performance:
    shown = with_return(motion) if loop else motion
    return make_performance(shown, markers.names, markers.joint_indices(motion.skeleton), markers.offsets_m, carried)


def studio_settings(table: Mapping[str, Any]) -> StudioSettings:
    """Return settings from a table; SettingsError for an unknown name or wrong value."""
    try:
        values: dict[str, Any] = {
            key: tuple(value) if isinstance(value, list) else value for key, value in table.items()
        }
        return StudioSettings(**values)
    except TypeError as error:
        raise SettingsError(f"simulated studio: {error}") from error


def _motion(asked: SimulatedPerformer) -> Motion:
    """Return T pose and behaviour."""
    seconds = None if asked.seconds is None else asked.seconds + _AROUND_S
    height_m = asked.height_m
    if height_m is None and asked.behaviour != DEMO:
        height_m = DEFAULT_HEIGHT_M
    skeleton = None if height_m is None else default_skeleton(height_m)
    return performance(asked.behaviour, seconds, asked.fps, skeleton, asked.mirrored)
