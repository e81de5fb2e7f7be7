"""Well-formed inputs: the tests' corpus, and packets and frames of a T pose."""

import json
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from perfanim.core.body.calibration_poses import t_pose
from perfanim.core.body.scene_pose import PerformerPose
from perfanim.core.body.skeleton import marker_positions
from perfanim.core.database.store import open_database
from perfanim.core.formats.take_file.pose_codec import TimedPose, pack_solved
from perfanim.core.formats.take_file.take_reader import read_take_file
from perfanim.core.formats.take_file.take_setup import plain
from perfanim.core.formats.vmc.vmc_packets import FramePackets
from perfanim.core.markers.marker_frame import MarkerFrame
from perfanim.core.markers.marker_frame_codec import pack_stamped
from perfanim.core.markers.subject import load_subject, skeleton_table, subject_tables
from perfanim.core.session.session import Session
from perfanim.core.sketch.sketch_file import Control, Sketch
from perfanim.core.sketch.solve_sketch import SketchSettings
from perfanim.core.system.schema import table_of
from perfanim.core.worker.protocol import MessageKind, encode, encode_frame, encode_json
from perfanim.core.worker.restart_point import RestartPoint

_TESTS = Path(__file__).resolve().parents[2]
_FOLDERS = (_TESTS / "compatibility" / "files", _TESTS / "fuzz" / "corpus")
_FOUND, _GUIDED = _TESTS / "fuzz" / "found", _TESTS / "fuzz" / "guided"
_FPS = 30.0


class Samples:
    """Inputs to begin with.

    Attributes:
        marker_set: worn by the person of the frames.
    """

    def __init__(self) -> None:
        self._subject = load_subject(_FOLDERS[0] / "anna.toml")
        self.marker_set = self._subject.marker_set
        skeleton = self._subject.skeleton
        joints, offsets = self.marker_set.joint_indices(skeleton), self.marker_set.offsets_m
        self._markers_m = marker_positions(skeleton, joints, offsets, t_pose(skeleton), np.array([0.0, 1.0, 0.0]))
        self._database = cache(lambda: open_database(_FOLDERS[0] / "motion.pfdb"))

    def files(self, pattern: str, ending: str = "") -> tuple[bytes, ...]:
        """Return the contents of the corpus' files, and of those that did harm once."""
        paths = [path for folder in _FOLDERS for path in sorted(folder.glob(pattern))]
        paths += [path for path in sorted(_FOUND.glob("*" + ending)) if ending]
        return tuple(path.read_bytes() for path in paths)

    def guided(self, ending: str) -> tuple[bytes, ...]:
        """Return the contents of tiny files that guided fuzzing found."""
        return tuple(path.read_bytes() for path in sorted(_GUIDED.glob("*" + ending)))

    def frame(self, number: int, labelled: bool = True) -> MarkerFrame:
        """Return a frame of the T pose."""
        count = len(self._markers_m)
        covariances = np.broadcast_to(1e-6 * np.eye(3), (count, 3, 3))
        labels = np.arange(count) if labelled else np.full(count, -1)
        return MarkerFrame(number, number / _FPS, self._markers_m, covariances, labels)

    def stamped_frames(self) -> tuple[bytes, ...]:
        """Return packed frames with labels and without, and empty."""
        frames = (self.frame(1), self.frame(1, labelled=False), MarkerFrame(1, 1 / _FPS))
        return tuple(pack_stamped(0.5, frame) for frame in frames)

    def session(self) -> Session:
        """Return a new session of the person."""
        return Session(self._subject, self._database())

    @staticmethod
    def is_finite(pose: PerformerPose) -> bool:
        """Return whether all numbers of a pose are finite."""
        return bool(np.all(np.isfinite(pose.rotations)) and np.all(np.isfinite(pose.root_position_m)))

    def packets(self) -> tuple[bytes, ...]:
        """Return VMC packets of bones and of trackers."""
        bones = FramePackets(("Hips", "Spine", "Head")).packet(0.5, np.zeros((3, 3)), np.tile((1.0, 0, 0, 0), (3, 1)))
        return bones, bones.replace(b"/VMC/Ext/Bone/Pos", b"/VMC/Ext/Tra/Pos\0")

    def poses(self) -> tuple[bytes, ...]:
        """Return packed poses."""
        return tuple(pack_solved(pose) for pose in self._recorded())

    def messages(self) -> tuple[bytes, ...]:
        """Return streams of messages of all kinds that a worker gets and sends."""
        status = encode_json(MessageKind.STATUS, {"activity": "solving", "fraction": 0.5, "frames": 3, "queued": 0})
        parts: Sequence[bytes] = (
            encode_json(MessageKind.HELLO, {"token": "0" * 32, "process": 1234}),
            status,
            encode_frame(0.5, self.frame(1)),
            *(encode(MessageKind.POSE, pose) for pose in self.poses()),
            encode(MessageKind.PREVIEW, b"\2\0\2\0" + bytes(12)),
            encode_json(MessageKind.ERROR, {"what": "failed", "where": "here", "advice": "try again"}),
            encode_json(MessageKind.REQUEST, {"job": "command", "arguments": ["take", "info"]}),
            encode_json(MessageKind.END, {"frames": 3}),
        )
        return (b"".join(parts), *parts)

    def requests(self) -> tuple[bytes, ...]:
        """Return requests to a worker."""
        cameras = {"source": {"kind": "simulated", "behaviour": "walking"}, "rig": None, "background_s": 2.0}
        sketch = Sketch("a", 30.0, (Control("root", np.array([0.0]), np.zeros((1, 3))),))
        tables = {"sketch": table_of(sketch), "settings": table_of(SketchSettings())}
        rows: Sequence[dict[str, Any]] = (
            {
                "job": "capture",
                "cameras": {**cameras, "after": table_of(RestartPoint(3, 0.1, 5.0))},
                "performers": [subject_tables(self._subject)],
                "database": "/no/a.pfdb",
                "shape": {"smoothing_s": 0.1, "feet": "auto"},
                "vmc": {"host": "localhost", "port": 39_539},
            },
            {
                "job": "record pose",
                **cameras,
                "marker_set": "boxing",
                "poses": ["t"],
                "seconds": 2.0,
                "out": "/no/a.npz",
            },
            {"job": "check setup", **cameras, "marker_set": "boxing", "ignored": [[0, 1.5, 2.0]]},
            {"job": "sketch", "skeleton": skeleton_table(self._subject.skeleton), "database": "/no/a.pfdb", **tables},
        )
        return tuple(json.dumps(row, default=plain).encode() for row in rows)

    @staticmethod
    def pictures() -> tuple[bytes, ...]:
        """Return a small picture in each kind."""
        image = np.tile(np.arange(24, dtype=np.uint8)[:, None, None], (1, 32, 3))
        endings = (".png", ".jpg", ".bmp", ".tif", ".webp", ".ppm")
        return tuple(cv2.imencode(ending, image)[1].tobytes() for ending in endings)

    @staticmethod
    def videos(folder: Path) -> tuple[bytes, ...]:
        """Return a short video; it is written into `folder`."""
        path = folder / "sample.avi"
        writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), _FPS, (32, 24))
        for grey in range(3):
            writer.write(np.full((24, 32, 3), 50 * grey, np.uint8))
        writer.release()
        return (path.read_bytes(),)

    @staticmethod
    def _recorded() -> list[TimedPose]:
        return list(read_take_file(_FOLDERS[0] / "written-live.perftake").poses[:2])
