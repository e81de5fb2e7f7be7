"""`perfanim vmc`: send and record motion live over the VMC protocol."""

import argparse
from functools import partial
from pathlib import Path
from typing import Any

from ..body.motion import Motion, resampled
from ..formats.markers.marker_files import WRITABLE, check_ending, is_recorded, write_take
from ..formats.motion.read_motion import read_motion
from ..formats.motion.write_motion import MOTION_ENDINGS, is_motion, write_motion
from ..formats.take_file.take_reader import ENDING, read_take_file
from ..formats.vmc.humanoid import BONES
from ..formats.vmc.ports import MARIONETTE_PORT, PERFORMER_PORT
from ..formats.vmc.vmc_udp import Receiver, play, record
from ..markers.steady_take import take_clock
from ..session.steady_motion import pose_clock, steady_motion
from ..system.progress import Progress
from .options import add_command, add_group, add_text, positive, rate_hz


def add_parser(subparsers: Any) -> None:
    group = add_group(subparsers, "vmc", "send and receive live motion (Virtual Motion Capture protocol)")
    send = add_command(group, "send", run_send, "play a motion to another program in real time")
    send.add_argument("motion", metavar="MOTION", help=f"motion (.bvh, .amc) or recorded take ({ENDING})")
    other = f"the other program (default 127.0.0.1:{MARIONETTE_PORT})"
    add_text(send, "--to", "HOST:PORT", other, type=_address, default=("127.0.0.1", MARIONETTE_PORT))
    add_text(send, "--rate", "HZ", "frames per second (default: the motion's own)", type=rate_hz)
    receive = add_command(group, "receive", run_receive, "record bones or trackers that another program sends")
    receive.add_argument(
        "--port", type=_port, default=PERFORMER_PORT, help=f"UDP port; 0 for a free one (default {PERFORMER_PORT})"
    )
    sender = "address of the only computer to listen to, or any (default: this one, so no network is used)"
    add_text(receive, "--from", "HOST", sender, dest="sender", default="127.0.0.1")
    written = (
        f"bones become a motion ({', '.join(MOTION_ENDINGS)}), head set, controllers and trackers a marker take "
        f"({', '.join(WRITABLE)})"
    )
    add_text(receive, "--out", "FILE", written, required=True)
    add_text(
        receive,
        "--seconds",
        "S",
        "how long to record",
        type=partial(positive, most=3600.0, unit="seconds"),
        required=True,
    )


def _address(text: str) -> tuple[str, int]:
    host, colon, port = text.rpartition(":")
    if not (host and colon):
        raise argparse.ArgumentTypeError(f"{text!r} is not HOST:PORT")
    number = _port(port)
    if number == 0:
        raise argparse.ArgumentTypeError("nothing can be sent to port 0")
    return host.strip("[]"), number


def _port(text: str) -> int:
    if not (text.isdecimal() and int(text) < 65536):
        raise argparse.ArgumentTypeError(f"{text!r} is not a port number from 0 to 65535")
    return int(text)


def run_send(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    progress(0.0, "reading")
    motion, warnings = _motion(args.motion, args.rate)
    host, port = args.to
    sent = play(motion, host, port, progress)
    return {
        "frames": motion.frames,
        "fps": motion.fps,
        "duration_s": motion.duration_s,
        "bones": len(BONES),
        "bytes": sent,
        "to": f"{host}:{port}",
        "warnings": warnings,
    }


def _motion(path: str, rate_hz: float | None) -> tuple[Motion, list[str]]:
    """Return a file's motion at a rate (None for its own), and notes about its times."""
    if not is_recorded(path):
        motion = read_motion(path)
        return resampled(motion, rate_hz or motion.fps), list(motion.notes)
    take = read_take_file(path)
    poses = take.recorded_poses_of()
    clock = pose_clock(poses, path)
    return steady_motion(poses, take.setup.subjects()[0], take.notes.name, clock.at(rate_hz)), clock.sentences


def run_receive(args: argparse.Namespace, progress: Progress) -> dict[str, Any]:
    out = Path(args.out)
    check_ending(out, (*MOTION_ENDINGS, *WRITABLE))
    with Receiver(args.port, "" if args.sender == "any" else args.sender) as receiver:
        recording = record(receiver, args.seconds, progress)
        others = receiver.others
    facts: dict[str, Any]
    if is_motion(out):
        motion, received = recording.motion(out.name.split(".")[0])
        write_motion(motion, out)
        facts = {"frames": received, "lost_frames": max(motion.frames - received, 0), "fps": motion.fps}
    else:
        markers = recording.markers(out.name.split(".")[0])
        write_take(markers, out)
        facts = {
            "frames": markers.frames,
            "lost_frames": take_clock(markers).lost,
            "fps": markers.fps,
            "names": list(markers.names),
        }
    came = recording.gathering
    facts |= {"packets": came.packets, "malformed": came.malformed, "flooding": came.flooding, "out": str(out)}
    warning = (
        f"ignored {', '.join(others)}, which sent to the same port; close the other program, or give it another port"
    )
    return facts | ({"warnings": [warning]} if others else {})
