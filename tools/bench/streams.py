"""Two streams of images through the stages of live capture, to labelled points."""

import struct
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.shared_memory import SharedMemory

import cv2
import numpy as np
from perfanim.core.body.scene_pose import PerformerPose
from perfanim.core.database.store import Database
from perfanim.core.errors import CaptureError
from perfanim.core.geometry.arrays import Array, Image
from perfanim.core.geometry.camera import CameraRig
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.markers.marker_frame_codec import pack, unpack
from perfanim.core.markers.subject import Subject
from perfanim.core.session.session import Session
from perfanim.core.simulate.studio.simulated_source import open_simulated
from perfanim.core.vision.live_frames import live_frames, live_settings
from perfanim.core.vision.pipeline import MarkerPipeline
from perfanim.core.vision.sources.image_set import ImageSet

STAGES = ("detect", "locate", "label")
_FPS = 240.0  # of the cameras: as many as are to be followed
_EMPTY = 30  # images of the room that the background is learned from
_SKIPPED_S, _LEAST_S = 4.0, 3.0  # of the performance: T pose and arms down come first
_BLOCK = 40  # pairs that one measurement of processor time goes over: the clock's steps are coarse
_STAMP = struct.Struct("<d")


@dataclass(frozen=True)
class Streams:
    """Images of the simulated studio, drawn beforehand.

    Args:
        rig, subject: the true cameras and performer.
        empty: (E, C, H, W, 3) of the room.
        images: (N, C, H, W, 3) one moment after another.
    """

    rig: CameraRig
    subject: Subject
    empty: Image
    images: Image

    def moments(self, passes: int) -> list[int]:
        """Return the indices of the images to show, forward and backward.

        So the performer never jumps.
        """
        count = len(self.images)
        return (list(range(count)) + list(range(count - 2, 0, -1))) * passes


def render_streams(pairs: int) -> Streams:
    """Render a boxing performer in a furnished room before two cameras of 640x480."""
    source = open_simulated({"behaviour": "boxing", "fps": _FPS, "seconds": _LEAST_S + pairs / _FPS})
    first = round(_SKIPPED_S * _FPS)
    empty = np.array(list(source.background_frames(_EMPTY)))
    return Streams(source.rig, source.subject, empty, np.array([source.frame(first + i).images for i in range(pairs)]))


def _sets(images: Image, moments: Sequence[int]) -> Iterator[ImageSet]:
    for number, moment in enumerate(moments):
        yield ImageSet(number, (number / _FPS,) * images.shape[1], tuple(images[moment]))


def _pipeline(rig: CameraRig, empty: Image) -> MarkerPipeline:
    pipeline = MarkerPipeline(rig, live_settings())
    pipeline.learn_empty(tuple(moment) for moment in empty)
    return pipeline


@dataclass(frozen=True)
class StageTimes:
    """Processor time of a pair of images, milliseconds, and the results.

    Args:
        milliseconds: per stage (B,), measured over blocks of pairs.
        poses: (N,) solved from the points; labelling starts from them.
        located: share of the markers that were located in space and labelled.
    """

    milliseconds: dict[str, Array]
    poses: tuple[PerformerPose, ...]
    located: float


def stage_times(streams: Streams, database: Database) -> StageTimes:
    """Process the streams stage by stage, block by block, in this process."""
    pipeline = _pipeline(streams.rig, streams.empty)
    session = Session(streams.subject, database, streams.rig)
    labelling = Session(streams.subject, database, streams.rig)
    milliseconds: dict[str, list[float]] = {stage: [] for stage in STAGES}
    poses: list[PerformerPose] = []
    located = 0
    sets = list(_sets(streams.images, range(len(streams.images))))
    for start in range(0, len(sets), _BLOCK):
        block = sets[start : start + _BLOCK]
        clock = [time.process_time()]
        seen = [pipeline.detect(images) for images in block]
        clock.append(time.process_time())
        frames = [pipeline.locate(moment) for moment in seen]
        clock.append(time.process_time())
        poses += [session.step(frame) for frame in frames]
        before = [poses[max(start + i - 1, 0)] for i in range(len(frames))]
        labels_from = time.process_time()
        observed = [_label(labelling, frame, pose) for frame, pose in zip(frames, before, strict=True)]
        taken = [*np.diff(clock), time.process_time() - labels_from]
        for stage, seconds in zip(milliseconds, taken, strict=True):
            milliseconds[stage].append(1e3 * seconds / len(block))
        located += sum(observed)
    share = located / (len(sets) * len(streams.subject.marker_set))
    return StageTimes({stage: np.array(rows) for stage, rows in milliseconds.items()}, tuple(poses), share)


def _label(session: Session, frame: MarkerFrame, before: PerformerPose) -> int:
    """Label a frame by the pose before; return the number of located markers."""
    return int(session.labeller.label_tracked(frame, before.markers_m, 1.0 / _FPS).located.sum())


@dataclass(frozen=True)
class Throughput:
    """How fast pairs go through two processes.

    Args:
        pairs_s: pairs a second, from the first in hand to the last labelled.
        cameras_ms, labels_ms: processor time of a pair in the cameras' process and in the one that labels.
        located: as in `StageTimes`.
    """

    pairs_s: float
    cameras_ms: float
    labels_ms: float
    located: float


def throughput(streams: Streams, database: Database, poses: Sequence[PerformerPose], passes: int) -> Throughput:
    """Send the streams through the cameras' process at full speed and label them here.

    Raises:
        CaptureError: that process failed.
    """
    moments = streams.moments(passes)
    session = Session(streams.subject, database, streams.rig)
    memory = SharedMemory(create=True, size=streams.images.nbytes + streams.empty.nbytes)
    shapes = (streams.empty.shape, streams.images.shape)
    for part, images in zip(_shared(memory, shapes), (streams.empty, streams.images), strict=True):
        part[:] = images
    context = get_context("spawn")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_film, args=(memory.name, shapes, streams.rig, moments, sender))
    try:
        process.start()
        sender.close()  # or its end would not show here
        located, first_s, last_s = 0, 0.0, 0.0
        for number in range(len(moments)):
            data = receiver.recv_bytes()
            if number == 0:
                labels_from_s, first_s = time.process_time(), _STAMP.unpack_from(data)[0]
            before = poses[moments[max(number - 1, 0)]]
            located += _label(session, unpack(data[_STAMP.size :]), before)
            last_s = time.perf_counter()
        labels_s = time.process_time() - labels_from_s
        (cameras_s,) = _STAMP.unpack(receiver.recv_bytes())
    except EOFError as error:
        raise CaptureError("ended before all images were through", where="the cameras' process") from error
    finally:
        process.join()
        memory.close()
        memory.unlink()
    return Throughput(
        len(moments) / (last_s - first_s),
        1e3 * cameras_s / len(moments),
        1e3 * labels_s / len(moments),
        located / (len(moments) * len(streams.subject.marker_set)),
    )


def _shared(memory: SharedMemory, shapes: Sequence[tuple[int, ...]]) -> list[Image]:
    """Return arrays of 8 bits in shared memory, one after another."""
    starts = np.concatenate(([0], np.cumsum([np.prod(shape) for shape in shapes]))).tolist()
    return [
        np.ndarray(shape, dtype=np.uint8, buffer=memory.buf, offset=start)
        for shape, start in zip(shapes, starts[:-1], strict=True)
    ]


def _film(
    name: str, shapes: Sequence[tuple[int, ...]], rig: CameraRig, moments: Sequence[int], sender: Connection
) -> None:
    """Be the cameras' process; at the end send its processor time."""
    cv2.setNumThreads(1)  # as `camera_job`
    memory = SharedMemory(name)
    empty, images = (np.array(part) for part in _shared(memory, shapes))
    memory.close()
    pipeline = _pipeline(rig, empty)
    started_s = time.process_time()
    for stamp_s, frame in live_frames(_sets(images, moments), pipeline, lambda warning: None, exact=False):
        sender.send_bytes(_STAMP.pack(stamp_s) + pack(frame))
    sender.send_bytes(_STAMP.pack(time.process_time() - started_s))
