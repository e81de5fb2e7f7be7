"""Flood the port of the trackers while a capture runs.

The whole chain of a capture runs: a process that ticks 60 times a second in Blender's place, the solver's process, and
the one that listens. A program sends nine markers 60 times a second; then others flood the same port, by turns with

- junk: bytes that are no packets,
- names: trackers with ever new names,
- frames: one marker of the set in each packet, so that each is a frame.

A row is wrong where

- the workers' memory grows by more than 64 MB, or that of Blender's place by more than 16 MB,
- more than 360 frames wait for the solver: what a second may bring before it is a flood, and what then may wait,
- the flood is not reported within two seconds, or at its end fewer packets are reported than were too many,
- a tick takes longer than 50 ms, or two seconds after the flood there is no pose of that moment.

Linux only: it looks at /proc.
"""

import itertools
import json
import random
import re
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from perfanim.core.formats.motion.read_motion import read_motion
from perfanim.core.formats.vmc.frame_assembler import LIMITS
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.system.assets import MOTION
from perfanim.core.worker.client import WorkerClient
from perfanim.perfanim_addon.capture.capture_run import CaptureRun, Phase
from trackers_sent import tracker_packet

from .processes import HELPERS, Row, family, memory_mb, simulated_request

RATE = 100_000  # datagrams a second
KINDS = ("junk", "names", "frames")
FPS = 60.0
AROUND_S = 5.0  # without a flood, before it and after it
MOST_LATE_S = 2.0
REPORT_LIMIT_S = 20.0
PREPARED = 4096  # packets that are sent in turn
BURST_S = 0.002
START_LIMIT_S = 120.0
MOST_WORKERS_MB, MOST_BLENDER_MB, MOST_TICK_S, MOST_WAITING = 64.0, 16.0, 0.05, 360


def rows(count: int, seed: int) -> Iterator[Row]:
    """Yield the row of each kind of flood, `count` seconds of each."""
    for kind in KINDS:
        found = flooded(kind, count, RATE, seed)
        yield found | {"wrong": wrong_of(found)}


def flooded(kind: str, seconds: float, rate: int, seed: int, around_s: float = AROUND_S) -> dict[str, Any]:
    """Return the figures of one capture with a flood."""
    with tempfile.TemporaryDirectory(prefix="vmc-flood-") as name:
        folder = Path(name)
        port = _free_port()
        client = WorkerClient(
            simulated_request(folder, {"kind": "vmc", "port": port, "sender": "127.0.0.1"}, [str(_walk())])
        )
        run = CaptureRun(client)
        asked = {"kind": kind, "port": port, "seconds": seconds, "rate": rate, "seed": seed, "around_s": around_s}
        try:
            _listening(run, port)
            with (folder / "sent").open("w") as said:
                sender = subprocess.Popen(
                    [sys.executable, "-m", "soak.trackers", json.dumps(asked)], stdout=said, cwd=HELPERS
                )
            try:
                watch = _watch(run, client, sender, folder / "sent")
            finally:
                sender.kill()
                sender.wait()
        finally:
            run.close()
    return {"kind": kind, **watch, "too_many": watch["sent"] - LIMITS.packets * (seconds + 1.0)}


def _listening(run: CaptureRun, port: int) -> None:
    limit_s = time.monotonic() + START_LIMIT_S
    while f"port {port}" not in run.activity:
        run.tick()
        if run.phase is Phase.DONE or time.monotonic() > limit_s:
            raise SystemExit(f"the capture did not start: {run.error}")
        time.sleep(1.0 / FPS)


def _watch(run: CaptureRun, client: WorkerClient, sender: "subprocess.Popen[bytes]", said: Path) -> dict[str, Any]:
    """Tick until the sender ends; return the figures."""
    base_mb = base_blender_mb = most_mb = most_blender_mb = 0.0
    ticks_s, waits, reports = [0.0], [0], dict[str, float]()
    moments: dict[str, Any] = {}
    again_s = float("inf")
    limit_s = float("inf")
    while run.phase is not Phase.DONE and time.monotonic() < limit_s:
        if sender.poll() is not None:
            limit_s = min(limit_s, 0.0 if any(map(_left_out, reports)) else time.monotonic() + REPORT_LIMIT_S)
        moments = dict(json.loads(line) for line in said.read_text().splitlines() if line.endswith("]"))
        begun_s = time.perf_counter()
        pose = run.tick()
        now_s = time.perf_counter()
        workers_mb = sum(memory_mb(process) for process in family(client.process_id))
        blender_mb = memory_mb("self")
        if "begin" not in moments:
            base_mb, base_blender_mb = workers_mb, blender_mb
        else:
            ticks_s.append(now_s - begun_s)
            most_mb, most_blender_mb = max(most_mb, workers_mb), max(most_blender_mb, blender_mb)
            waits.append(run.statistics.waiting)
            for text in (*run.warnings, run.persistent_warning):
                reports.setdefault(text, now_s - moments["begin"])
        # a pose of after the flood, in time: not one of those that waited
        if pose is not None and "end" in moments and run.statistics.waiting < FPS / 10 and again_s == float("inf"):
            again_s = now_s - moments["end"]
        time.sleep(max(1.0 / FPS - (time.perf_counter() - begun_s), 0.0))
    return {
        "sent": moments.get("sent", 0),
        "rate": moments.get("sent", 0) / (moments["end"] - moments["begin"]) if "end" in moments else 0.0,
        "grown_mb": most_mb - base_mb,
        "blender_mb": most_blender_mb - base_blender_mb,
        "waiting": max(waits),
        "tick_ms": 1e3 * max(ticks_s),
        "reported_s": min(
            (at_s for text, at_s in reports.items() if "too many packets arrive" in text), default=float("inf")
        ),
        "left_out": sum(_left_out(text) for text in reports),
        "again_s": again_s,
        "reports": [text for text in reports if text],
        "error": str(run.error or ""),
    }


def _left_out(text: str) -> int:
    count = re.match(r"(\d+) excess packets", text)
    return int(count[1]) if count else 0


def wrong_of(found: dict[str, Any]) -> list[str]:
    """Return the figures that must not be so."""
    limits = {"grown_mb": MOST_WORKERS_MB, "blender_mb": MOST_BLENDER_MB, "waiting": MOST_WAITING,
              "tick_ms": 1e3 * MOST_TICK_S, "again_s": MOST_LATE_S, "reported_s": MOST_LATE_S}  # fmt: skip
    wrong = [f"{name} above {limit:g}" for name, limit in limits.items() if found[name] > limit]
    if found["left_out"] < found["too_many"]:
        wrong.append("fewer packets are reported than were too many")
    return wrong + ([found["error"]] if found["error"] else [])


def _walk() -> Path:
    return min(MOTION.glob("walking*.bvh"))


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.bind(("127.0.0.1", 0))
        return int(link.getsockname()[1])


def _send(kind: str, port: int, seconds: float, rate: int, seed: int, around_s: float) -> None:
    """Send markers all the time and a flood for a while; print begin, end and count."""
    take, _ = simulate_markers(read_motion(_walk()), load_marker_set("boxing"))
    step = max(round(take.fps / FPS), 1)
    frames = [tracker_packet(dict(zip(take.names, row, strict=True))) for row in take.positions_m[::step].tolist()]
    markers = itertools.cycle([*frames, *frames[::-1]])
    packets = itertools.cycle(list(_flood(kind, random.Random(seed))))  # noqa: S311 - no secrets
    burst, sent = round(rate * BURST_S), 0
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.connect(("127.0.0.1", port))
        begin_s = time.perf_counter() + around_s
        end_s, next_frame_s, next_burst_s, flooding = begin_s + seconds, 0.0, begin_s, False
        while (now_s := time.perf_counter()) < end_s + around_s:
            if now_s >= next_frame_s:
                next_frame_s = max(next_frame_s + 1.0 / FPS, now_s)
                link.send(next(markers))
            if flooding != (begin_s <= now_s < end_s):
                flooding = not flooding
                _say("begin" if flooding else "end", now_s)
                _say("sent", sent)
            if flooding and now_s >= next_burst_s:
                next_burst_s += BURST_S
                for packet in itertools.islice(packets, burst):
                    link.send(packet)
                sent += burst
            elif not flooding or next_burst_s > now_s:
                time.sleep(BURST_S / 4)


def _flood(kind: str, chance: random.Random) -> Iterator[bytes]:
    for number in range(PREPARED):
        if kind == "junk":
            yield chance.randbytes(chance.randrange(1, 64))
        elif kind == "names":
            yield tracker_packet({f"{chance.randbytes(6).hex()}{number}": (0.0, 1.0, 0.0)})
        else:
            yield tracker_packet({"HEAD": (chance.uniform(-1.0, 1.0), 1.7, 0.0)})


def _say(what: str, number: float) -> None:
    sys.stdout.write(json.dumps([what, number]) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    _send(**json.loads(sys.argv[1]))
