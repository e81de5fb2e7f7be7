"""Doors: readers of files, packets, messages, descriptions, commands, frames."""

import json
import tempfile
from collections.abc import Callable, Sequence
from contextlib import chdir
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

from hypothesis import strategies as st
from perfanim.core.cli.batch.plan import read_plan
from perfanim.core.cli.main import build_parser
from perfanim.core.cli.main import main as command_line
from perfanim.core.database.store import check_arrays, open_database
from perfanim.core.errors import CaptureError, PerfanimError
from perfanim.core.formats.markers.marker_files import read_take
from perfanim.core.formats.motion.amc import amc_motion, parse_amc_values
from perfanim.core.formats.motion.asf import parse_asf, read_asf
from perfanim.core.formats.motion.motion_sources import motion_files
from perfanim.core.formats.motion.read_motion import read_motion_parts
from perfanim.core.formats.take_file.pose_codec import unpack_solved
from perfanim.core.formats.take_file.take_reader import read_take_file, summarise
from perfanim.core.formats.vmc.tracker_stream import TrackerStream
from perfanim.core.geometry.rig_file import load_rig
from perfanim.core.markers.label_matching import load_names
from perfanim.core.markers.marker_frame_codec import unpack_stamped
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.prop import load_prop
from perfanim.core.markers.subject import load_subject
from perfanim.core.retarget.bone_map_files import read_bone_map
from perfanim.core.sketch.sketch_file import read_sketch
from perfanim.core.sketch.sketch_messages import settings_from, sketch_from
from perfanim.core.system.files import read_bytes
from perfanim.core.vision.calibration.board_points import load_board_points
from perfanim.core.vision.sources.image_files import read_image
from perfanim.core.vision.sources.video_source import VideoSource
from perfanim.core.worker.open_source import open_source
from perfanim.core.worker.process import JOBS
from perfanim.core.worker.protocol import Decoder, Message, MessageKind
from perfanim.core.worker.requests import read_request

from .containers import damaged_database, damaged_take, damaged_tar, damaged_zip
from .damage import Damage, damaged_bytes, damaged_json, damaged_packet, damaged_text, damaged_toml
from .samples import Samples

Reader = Callable[[Path], Any]


@dataclass(frozen=True)
class Door:
    """A place where something comes in.

    Args:
        corpus: well-formed inputs, and those that did harm once.
        guided: inputs that go further in the code; too broken to be changed at random.
        change: makes damaged ones of them.
        read: what the project does with an input.
        ending: of the files that hold its inputs.
        slack_bytes: memory that it may take beside four times the input's bytes.
        longest_s: of the processor's time, that an input of any kind may take.
        share: of the inputs that each door gets; less where one takes long.
    """

    name: str
    corpus: tuple[bytes, ...]
    damage: Damage
    read: Callable[[bytes], None]
    ending: str = ""
    guided: tuple[bytes, ...] = ()
    slack_bytes: int = 64 << 20
    longest_s: float = 2.0
    share: float = 1.0


def all_doors(folder: Path) -> list[Door]:
    """Return all doors; files are written into `folder`."""
    samples = Samples()
    return [
        *_file_doors(folder, samples),
        *_image_doors(folder, samples),
        *_stream_doors(samples),
        _request_door(samples),
        _description_door(),
        _command_door(folder),
    ]


def _file_doors(folder: Path, samples: Samples) -> list[Door]:
    """Return the readers of files."""
    skeleton = parse_asf(samples.files("*.asf")[0], "the corpus")

    def read_amc(path: Path) -> None:
        amc_motion(parse_amc_values(read_bytes(path), str(path), skeleton), skeleton, 120.0, "")

    def read_markers(path: Path) -> None:
        read_take(path)

    def unpack(path: Path) -> None:
        with motion_files([path]) as files:
            for file in files:
                read_motion_parts(file.path, file.skeleton)

    rows: Sequence[tuple[str, str, str, Damage, Reader]] = (
        ("BVH", "*.bvh", ".bvh", damaged_text, read_motion_parts),
        ("ASF", "*.asf", ".asf", damaged_text, read_asf),
        ("AMC", "*.amc", ".amc", damaged_text, read_amc),
        ("archive", "*.zip", ".zip", damaged_zip, unpack),
        ("tar archive", "*.tar.gz", ".tar.gz", damaged_tar, unpack),
        ("board points", "board-points.json", ".json", damaged_json, load_board_points),
        ("TRC", "*.trc", ".trc", damaged_text, read_markers),
        ("CSV", "*.csv", ".csv", damaged_text, read_markers),
        ("array of keypoints", "*.npy", ".npy", damaged_bytes, read_markers),
        ("Qualisys TSV", "*.tsv", ".tsv", damaged_text, read_markers),
        ("C3D", "*.c3d", ".c3d", damaged_bytes, read_markers),
        ("marker take", "*.take.npz", ".take.npz", damaged_zip, read_markers),
        ("recorded take", "written-live.perftake", ".perftake", damaged_take, _read_recorded),
        ("database", "*.p*fdb", ".pfdb", damaged_database, lambda path: check_arrays(open_database(path))),
        ("calibration", "camera*.*", ".toml", damaged_toml, load_rig),
        ("stereo calibration in JSON", "stereo.json", ".json", damaged_json, load_rig),
        ("stereo calibration in YAML", "stereo.yaml", ".yaml", damaged_text, load_rig),
        ("subject", "anna*.toml", ".toml", damaged_toml, load_subject),
        ("marker set", "marker-set*.toml", ".toml", damaged_toml, load_marker_set),
        ("prop", "prop-*.toml", ".toml", damaged_toml, load_prop),
        ("bone map", "bone-map*.toml", ".toml", damaged_toml, read_bone_map),
        ("sketch", "sketch.keys", ".csv", damaged_text, read_sketch),
        ("names", "names.toml", ".toml", damaged_toml, load_names),
        ("plan", "plan*.toml", ".toml", damaged_toml, lambda path: read_plan(path, {})),
    )
    return [
        Door(
            name,
            samples.files(pattern, ending),
            damage,
            _reader(read, folder / f"input{ending}"),
            ending,
            samples.guided(ending),
            share=_share(name),
        )
        for name, pattern, ending, damage, read in rows
    ]


def _read_recorded(path: Path) -> None:
    """Read all parts of a recorded take."""
    take = read_take_file(path)
    _read_each(
        lambda: summarise(path),
        lambda: (take.problems, take.notes, take.events, take.gaps),
        lambda: take.frames,
        lambda: take.recorded_poses,
        lambda: (take.setup.subjects(), take.setup.camera_rig(), take.setup.carried_props()),
        lambda: (take.setup.to_json(), take.notes.to_json()),
    )


def _read_each(*reads: Callable[[], object]) -> None:
    """Read all parts though some are refused, and raise the longest refusal."""
    refused = []
    for read in reads:
        try:
            read()
        except PerfanimError as error:
            refused.append(error)
    if refused:
        raise max(refused, key=lambda error: len(str(error)))


def _share(name: str) -> float:
    return 0.25 if "archive" in name else 1.0


def _reader(read: Reader, path: Path) -> Callable[[bytes], None]:
    def write_and_read(data: bytes) -> None:
        path.unlink(missing_ok=True)  # a reader may have mapped the last one
        path.write_bytes(data)
        read(path)

    return write_and_read


def _image_doors(folder: Path, samples: Samples) -> list[Door]:
    """Return the readers of pictures and videos."""

    def read_video(path: Path) -> None:
        source = VideoSource([path])
        for _ in islice(source, 5):
            pass
        source.close()

    # of 64 MB of pixels OpenCV makes another image where a picture lies on its side, and a progressive one takes more
    picture = _reader(read_image, folder / "input.png")
    video = _reader(read_video, folder / "input.avi")
    return [
        Door(
            "pictures",
            samples.pictures() + samples.files("*.png", ".png"),
            damaged_bytes,
            picture,
            slack_bytes=256 << 20,
        ),
        Door("videos", samples.videos(folder), damaged_bytes, video, slack_bytes=256 << 20, share=0.25),
    ]


def _stream_doors(samples: Samples) -> list[Door]:
    """Return the readers of packets, messages and frames."""

    def read_packets(data: bytes) -> None:
        stream = TrackerStream(samples.marker_set)
        for arrival_s in range(3):  # the same again ends a frame
            stream.add(data, float(arrival_s))

    def read_messages(data: bytes) -> None:
        for message in Decoder().feed(data):
            if message.kind is MessageKind.FRAME:
                unpack_stamped(message.payload)
            elif message.kind is MessageKind.POSE:
                message.pose()
            elif message.kind is MessageKind.PREVIEW:
                message.preview()
            elif message.kind is MessageKind.ERROR:
                message.error()
            else:
                message.json()

    return [
        Door("VMC packets", samples.packets(), damaged_packet, read_packets),
        Door("worker messages", samples.messages(), damaged_bytes, read_messages),
        Door("marker frames", samples.stamped_frames(), damaged_bytes, lambda data: _step(samples, data), share=0.25),
        Door("poses", samples.poses(), damaged_bytes, lambda data: _ignore(unpack_solved(data))),
    ]


def _ignore(_: object) -> None:
    """Take a result that nobody needs."""


def _step(samples: Samples, data: bytes) -> None:
    """Step over a damaged frame and a good one; the last pose must be finite."""
    _, damaged = unpack_stamped(data)
    session = samples.session()
    for frame in (samples.frame(0), damaged, samples.frame(1)):
        pose = session.step(frame)
    if not samples.is_finite(pose):
        raise ArithmeticError("the next pose is not finite")


def _request_door(samples: Samples) -> Door:
    """Return the reader of requests to the worker, up to where a job begins."""

    def read(data: bytes) -> None:
        request = Message(MessageKind.REQUEST, data).json()
        job = str(request.get("job"))
        if job not in JOBS:
            raise CaptureError("does not know the job")
        asked = read_request(job, request)
        if job == "sketch":
            sketch_from(asked.sketch)
            settings_from(asked.settings)

    return Door("worker requests", samples.requests(), damaged_json, read)


def _description_door() -> Door:
    """Return the reader of descriptions of image sources; no camera is opened."""
    corpus = tuple(
        json.dumps(row).encode()
        for row in (
            {"kind": "simulated", "behaviour": "walking", "seconds": 3, "fps": 30, "cameras": 2, "poses": ["t"]},
            {"kind": "simulated", "partners": [{"behaviour": "boxing", "height_m": 1.6}], "studio": {"ghosts": 2}},
            {"kind": "videos", "paths": ["/no/left.mp4", "/no/right.mp4"], "fps": 30},
            {"kind": "images", "paths": ["/no/left-*.png", "/no/right-*.png"], "fps": 30},
        )
    )

    def read(data: bytes) -> None:
        spec = json.loads(data) if data[:1] == b"{" and _is_json(data) else {}
        if isinstance(spec, dict) and spec.get("kind") != "cameras":
            open_source(spec).close()

    # the simulated performer moves for up to 83 minutes before cameras that see a furnished room
    return Door("image sources", corpus, damaged_json, read, slack_bytes=2 << 30, longest_s=15.0, share=0.05)


def _is_json(data: bytes) -> bool:
    try:
        json.loads(data)
    except (ValueError, RecursionError):
        return False
    return True


def _command_door(folder: Path) -> Door:
    """Return the command line, with commands that only read and end soon."""
    lines = (
        "take info FILE --json",
        "take export FILE --out out.csv",
        "database build FILE --out out.pfdb --fps 30",
        "database info FILE",
        "solve FILE --database FILE --subject FILE --out out.bvh --rate 30",
        "calibrate subject FILE --marker-set boxing --poses t --out out.toml",
        "evaluate FILE FILE",
        "track --cameras FILE --left FILE --right FILE --out out.perftake",
    )
    (folder / "FILE").write_bytes(b"damaged")
    build_parser()  # loads all commands, which takes seconds
    started = (*sorted({line.split()[0] for line in lines}),)

    def damage(sample: bytes) -> st.SearchStrategy[bytes]:
        return damaged_text(sample).map(lambda data: data[:4000])

    def read(data: bytes) -> None:
        words = [word for word in data.decode("utf-8", "surrogateescape").split() if "\0" not in word]
        if not words or words[0] not in started or any(word.startswith(("/", "..")) for word in words):
            return  # other commands listen, play or take minutes
        with tempfile.TemporaryDirectory(dir=folder) as inside, chdir(inside):
            Path("FILE").write_bytes(b"damaged")
            command_line(words)

    return Door("command line", tuple(line.encode() for line in lines), damage, read, share=0.5)
