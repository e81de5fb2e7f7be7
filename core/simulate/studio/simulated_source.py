"""Simulated performer as an image source, live or as fast as the images can be drawn."""

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ...body.motion import Motion
from ...body.standard_skeleton import DEFAULT_HEIGHT_M, default_skeleton
from ...errors import SettingsError
from ...geometry.arrays import Image
from ...geometry.camera import CameraRig
from ...markers.marker_set import load_marker_set
from ...markers.prop import Prop, load_prop
from ...markers.subject import Subject
from ...system.schema import Table
from ...vision.sources.image_set import ClosableSource
from ..shipped_performance import DEMO, performance, with_return
from .carried_prop import in_hand
from .filmed_motion import Performance, make_performance
from .render import Renderer, StudioFrame
from .simulated_performer import SIMULATED, SimulatedPerformer
from .stage_placement import STAGE, with_poses
from .studio_rig import FPS, default_rig
from .studio_settings import StudioSettings


@dataclass(eq=False)
class SimulatedSource(ClosableSource):
    """Image sets of a performance, with their ground truth.

    Args:
        subject: The performer's true skeleton and marker offsets.
        live: Yield frames in real time and drop late ones, as a camera does.
        loop: Start again when the performance is over.

    Attributes:
        first: Number of the first frame; not used when live.
        dropped: Number of frames dropped so far.
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
        """Number of image sets in one run of the performance."""
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
        """Yield image sets until the performance is over, or until `close`."""
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
    """Return the image source for a description of the simulated performer.

    Raises:
        SettingsError: A key, behaviour or setting is unknown.
        MarkerSetError: The marker set is unknown or has no offsets.
        PropError: The prop is unknown or unusable.
    """
    if not isinstance(asked, SimulatedPerformer):
        asked = SIMULATED.read({"kind": "simulated", **asked}, "simulated performer")
    if len(asked.partners) > STAGE.partners:
        message = f"{len(asked.partners)} partners of the simulated performer are too many"
        raise SettingsError(message, advice=f"give {STAGE.partners} at most")
    everybody = [asked, *(asked.partner(partner) for partner in asked.partners)]
    motions = []
    for number, one in enumerate(everybody):
        motion = with_poses(_motion(one), asked.poses, asked.held_s)
        place_m = np.array([STAGE.spacing_m * (number - 0.5 * len(asked.partners)), 0.0, 0.0])
        motions.append(replace(motion, root_positions_m=motion.root_positions_m + place_m))
    source = simulated_source(
        motions[0],
        asked.marker_set,
        Renderer(default_rig(asked.cameras), studio_settings(asked.studio)),
        fps=asked.fps,
        loop=asked.live if asked.loop is None else asked.loop,
        prop=load_prop(asked.prop) if asked.prop else None,
        partners=tuple((motion, one.marker_set) for motion, one in zip(motions[1:], everybody[1:], strict=True)),
    )
    source.live = asked.live
    return source


def simulated_source(
    motion: Motion,
    marker_set: str,
    renderer: Renderer,
    *,
    fps: float = FPS,
    loop: bool = False,
    prop: Prop | None = None,
    partners: Sequence[tuple[Motion, str]] = (),
) -> SimulatedSource:
    """Return an image source for a given motion.

    Args:
        marker_set: Name or file of a marker set with offsets.
        prop: Prop in the performer's hand.
        partners: Motions and marker sets of further performers.
    """
    performances = []
    for shown, worn, held in ((motion, marker_set, prop), *((*partner, None) for partner in partners)):
        markers = load_marker_set(worn)
        joints, carried = markers.joint_indices(shown.skeleton), in_hand(held) if held else None
        played = with_return(shown) if loop else shown
        performances.append(make_performance(played, markers.names, joints, markers.offsets_m, carried))
    subject = Subject("simulated performer", motion.skeleton, load_marker_set(marker_set))
    performance = replace(performances[0], partners=tuple(performances[1:]))
    return SimulatedSource(performance, subject, renderer, fps=fps, loop=loop)


def studio_settings(table: Mapping[str, Any]) -> StudioSettings:
    """Return settings from a table; SettingsError for an unknown name or an invalid value."""
    try:
        values: dict[str, Any] = {
            key: tuple(value) if isinstance(value, list) else value for key, value in table.items()
        }
        return StudioSettings(**values)
    except TypeError as error:
        advice = "correct the names of its settings"
        raise SettingsError(str(error), where="simulated studio", advice=advice) from error


def _motion(asked: SimulatedPerformer) -> Motion:
    """Return the motion: the T pose, if wanted, then the behaviour."""
    seconds = None if asked.seconds is None else asked.seconds + STAGE.around_s
    height_m = asked.height_m
    if height_m is None and asked.behaviour != DEMO:
        height_m = DEFAULT_HEIGHT_M
    skeleton = None if height_m is None else default_skeleton(height_m)
    return performance(asked.behaviour, seconds, asked.fps, skeleton, asked.mirrored, asked.at_once)
