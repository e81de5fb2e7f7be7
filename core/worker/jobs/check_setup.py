"""Job: check light, cameras, and markers or a person without them, before a capture.

The RESULT has "findings" (tables with "fault", "text" and "places") and "space" (where all cameras see a performer; ""
without a calibration that knows the floor). If the floor was found under a person's feet, it has "calibration", the
file with it; if it could not be found, "floor_advice". The last PREVIEW shows rings around the places of the findings,
with reflections numbered from 1 in the RESULT's order, crosses at ignored positions, and the space on the floor.
"""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from typing import Any

import cv2
import numpy as np

from ...body.calibration_poses import INSTRUCTIONS
from ...errors import CalibrationError, CaptureError, TakeError
from ...geometry.arrays import Image, evenly
from ...geometry.camera import Camera, CameraRig
from ...geometry.rig_file import save_rig
from ...markers.floor_from_feet import floor_points
from ...markers.marker_frame import MarkerFrame
from ...markers.marker_set import load_marker_set
from ...simulate.practice_studio import FPS, SECONDS, studio_with
from ...simulate.studio.simulated_performer import SimulatedPerformer
from ...subjects.setup_check.find_faults import check_pictures, check_setup, has_floor
from ...subjects.setup_check.finding import Fault, Finding
from ...subjects.setup_check.person_faults import check_others, check_person
from ...vision.blob_preview import cross_out, reduced
from ...vision.calibration.rig_on_floor import rig_on_floor
from ...vision.common_space import CommonSpace, common_space
from ...vision.detection.background import learn_backgrounds
from ...vision.people.people_pipeline import PeoplePipeline
from ...vision.people.person_preview import draw_person
from ...vision.sources.image_set import ImageSet
from ...vision.tracked_take import labelled_take
from ..channel import Channel, Stopped
from ..open_source import open_source
from ..requests import CheckSetupRequest
from .camera_frames import learn_room
from .film_starts import with_starts
from .person_pipeline import open_networks
from .preview_sender import Draw, PreviewSender
from .record_board import camera_names
from .record_pose import count_down, first_seconds

Facts = dict[str, Any]


@dataclass(frozen=True)
class CheckSettings:
    """Timing of a check, and drawings in its last picture; colours are BGR."""

    pose_s: float = 2.0  # duration of the T pose
    person_fps: float = 10.0  # image sets per second in which a person is looked for
    others_every: int = 5  # number of image sets of which one is kept to look for others in it
    others_sets: int = 4  # largest number of image sets in which others are looked for
    place: str = "stand where all cameras see you"  # what a person without markers is asked to do
    seed: int = 18  # random seed of the simulated studio with a fault
    ring: tuple[int, int, int] = (60, 170, 255)  # colour of the rings around findings
    ring_px: int = 9  # radius of the rings
    text: float = 1.2  # scale of the numbers beside the rings, OpenCV's fontScale
    space: tuple[int, int, int] = (80, 255, 80)  # colour of the space on the floor


_SETTINGS = CheckSettings()


def run(request: CheckSetupRequest, channel: Channel) -> None:
    """Run the check and send the RESULT.

    Raises:
        Stopped: A stop was requested meanwhile. PerfanimError: The source cannot be opened or used.
    """
    check = _check_person if request.people else _check_studio if request.fault else _check_source
    findings, space, facts = check(request, channel)
    rows = [{"fault": str(found.fault), "text": found.text, "places": found.places} for found in findings]
    channel.send_result({"findings": rows, "space": space.text if space else "", **facts})


def _check_source(request: CheckSetupRequest, channel: Channel) -> tuple[list[Finding], CommonSpace | None, Facts]:
    """Return the faults that the source's pictures show, and the space that its cameras see."""
    source_asked, rig = request.source, request.rig
    if isinstance(source_asked, SimulatedPerformer):
        source_asked = replace(source_asked, fps=FPS)
    channel.send_status("opening the cameras")
    with closing(open_source(source_asked)) as source:
        backgrounds = learn_room(source, request, channel)
        if not backgrounds:
            raise CaptureError("a video of unknown length cannot be checked", advice="choose cameras or another video")
        images = iter(source)
        if request.source.is_live:
            count_down(images, request.countdown_s, channel, INSTRUCTIONS["t"])
        names = [camera.name for camera in rig.cameras] if rig else camera_names(len(backgrounds))[0]
        moments = _Watched(islice(images, round(SECONDS * source.fps)), source.fps, channel)
        if rig is None:
            ignored = [(int(camera), x, y) for camera, x, y in request.ignored]
            findings = check_pictures(names, backgrounds, moments, ignored)
        else:
            ignored = rig.ignored.tolist()
            findings = check_setup(rig, backgrounds, moments, load_marker_set(request.marker_set))
        space = common_space(rig) if rig and "floor" in rig.metadata else None
        moments.show(findings, ignored, rig, space)
    return findings, space, {}


def _check_person(request: CheckSetupRequest, channel: Channel) -> tuple[list[Finding], CommonSpace | None, Facts]:
    """Return the faults in how the cameras see a person without markers, the space that they see, and the floor."""
    channel.send_status("opening the cameras")
    playing = with_starts(request, channel).source
    with open_networks(request) as pipeline, closing(open_source(playing, newest=True)) as source:
        images = iter(source)
        if request.source.is_live:
            count_down(images, request.countdown_s, channel, _SETTINGS.place)
        spaced = first_seconds(images, SECONDS, channel, apart_s=1.0 / _SETTINGS.person_fps)
        watched = _Watched(spaced, _SETTINGS.person_fps, channel, pose_s=0.0)
        frames: list[MarkerFrame] = []
        kept: list[tuple[ImageSet, MarkerFrame]] = []

        def moments() -> Iterator[tuple[ImageSet, MarkerFrame]]:
            for moment in watched:
                frames.append(pipeline.process(moment))
                watched.draw = partial(draw_person, frames[-1], pipeline.points.names)
                if len(frames) % _SETTINGS.others_every == 1:
                    kept.append((moment, frames[-1]))
                yield moment, frames[-1]

        findings = check_person(pipeline.rig, pipeline.points, moments()) or _others(pipeline, kept, channel)
        rig, facts = (pipeline.rig, {}) if findings else _on_floor(request, pipeline, frames)
        space = common_space(rig) if "floor" in rig.metadata else None
        watched.show(findings, (), rig, space)
    return findings, space, facts


def _others(
    pipeline: PeoplePipeline, moments: Sequence[tuple[ImageSet, MarkerFrame]], channel: Channel
) -> list[Finding]:
    """Return findings for cameras that show somebody besides the person."""
    found = []
    for number in evenly(len(moments), _SETTINGS.others_sets).tolist():
        images, frame = moments[number]
        if channel.stop_requested.is_set():
            raise Stopped
        channel.send_status("looking for others in the pictures", number / len(moments))
        found.append(pipeline.others(images, frame))
    middles = [[np.median(each, axis=0) for each in seen if each is not None] for seen in zip(*found, strict=True)]
    return check_others(pipeline.rig, [np.reshape(each, (-1, 2)) for each in middles])


def _on_floor(
    request: CheckSetupRequest, pipeline: PeoplePipeline, frames: Sequence[MarkerFrame]
) -> tuple[CameraRig, Facts]:
    """Return the cameras with the floor under the person's feet, and facts about it, unless they know the floor.

    A single camera does not show the floor: the depths of the feet are guesses.
    """
    rig, points = pipeline.rig, pipeline.points
    if not request.floor_out or has_floor(rig) or len(rig) == 1:
        return rig, {}
    take = labelled_take(frames, points.names, "check", _SETTINGS.person_fps, rig)
    try:
        level = rig_on_floor(rig, floor_points(take, points))
    except (TakeError, CalibrationError) as error:
        return rig, {"floor_advice": str(error)}
    save_rig(level, request.floor_out)
    return level, {"calibration": request.floor_out}


def _check_studio(request: CheckSetupRequest, channel: Channel) -> tuple[list[Finding], None, Facts]:
    """Return the faults found in a simulated studio that has the requested fault."""
    fault = Fault(request.fault)
    channel.send_status(f"building a simulated studio: {fault}")
    studio = studio_with(fault, np.random.default_rng(_SETTINGS.seed))
    moments = _Watched(studio.moments, FPS, channel)
    rig = studio.rig.ignoring(request.ignored)
    findings = check_setup(rig, learn_backgrounds(studio.empty), moments, studio.marker_set, studio.height_m)
    moments.show(findings, rig.ignored.tolist())
    return findings, None, {}


class _Watched:
    """Iterable of image sets that also sends previews of them, and instructions for the performer.

    Attributes:
        draw: Draws what was found in the last images.
    """

    def __init__(
        self, images: Iterable[ImageSet], fps: float, channel: Channel, pose_s: float = _SETTINGS.pose_s
    ) -> None:
        self._images, self._fps, self._channel, self._pose_s = images, fps, channel, pose_s
        self.draw: Draw = _draw_nothing
        self._preview = PreviewSender(True, channel)
        self._last: Sequence[Image] = ()

    def __iter__(self) -> Iterator[ImageSet]:
        for number, moment in enumerate(self._images):
            if self._channel.stop_requested.is_set():
                raise Stopped
            passed_s = number / self._fps
            text = f"hold still: {INSTRUCTIONS['t']}" if passed_s < self._pose_s else "walk about"
            self._channel.send_status(text, passed_s / SECONDS)
            self._last = moment.images
            yield moment
            self._preview.send(moment.images, self.draw)

    def show(
        self,
        findings: Sequence[Finding],
        ignored: Sequence[Sequence[float]],
        rig: CameraRig | None = None,
        space: CommonSpace | None = None,
    ) -> None:
        """Send the last images with rings, crosses, and the space."""

        def draw(camera: int, picture: Image, image_width: int) -> None:
            self.draw(camera, picture, image_width)
            if rig and space:
                _outline(rig.cameras[camera], space, picture, image_width)
            cross_out([(x, y) for index, x, y in ignored if index == camera], picture, image_width)
            _ring(findings, camera, picture, image_width)

        if self._last:
            PreviewSender(True, self._channel).send(self._last, draw)


def _draw_nothing(camera: int, picture: Image, image_width: int) -> None:
    """Leave the picture unchanged."""


def _outline(camera: Camera, space: CommonSpace, picture: Image, image_width: int) -> None:
    """Draw the rectangle on the floor that all cameras see."""
    pixels = (camera.project(space.outline_m) + 0.5) * picture.shape[1] / image_width - 0.5
    if len(pixels) and np.all(np.isfinite(pixels)):
        line = np.rint(pixels).astype(np.int32).reshape(-1, 1, 2)
        cv2.polylines(picture, [line], True, _SETTINGS.space, 2, cv2.LINE_AA)


def _ring(findings: Sequence[Finding], camera: int, picture: Image, image_width: int) -> None:
    number = 0
    for finding in findings:
        for index, x, y in finding.places:
            is_reflection = finding.fault is Fault.REFLECTION
            number += is_reflection
            if index == camera:
                centre = reduced((x, y), picture, image_width)
                cv2.circle(picture, centre, _SETTINGS.ring_px, _SETTINGS.ring, 2, cv2.LINE_AA)
                if is_reflection:
                    _write_beside(picture, centre, str(number))


def _write_beside(picture: Image, centre: tuple[int, int], text: str) -> None:
    """Write a text beside a ring, on the side where the picture has space for it."""
    (width, height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_PLAIN, _SETTINGS.text, 1)
    x = centre[0] + _SETTINGS.ring_px + 3
    if x + width > picture.shape[1]:
        x = centre[0] - _SETTINGS.ring_px - 3 - width
    y = min(max(centre[1] + height // 2, height), picture.shape[0] - 1)
    cv2.putText(picture, text, (x, y), cv2.FONT_HERSHEY_PLAIN, _SETTINGS.text, _SETTINGS.ring, 1, cv2.LINE_AA)
