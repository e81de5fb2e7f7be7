"""Kill or freeze processes of captures at random moments and check their takes.

Each time the whole chain of a capture runs: a process in Blender's place, the solver's process, the cameras' process
with the simulated performer. One of the three is killed (SIGKILL), by turns; every other time the two workers are
frozen (SIGSTOP) instead. "Received" are frames that the cameras had half a second before.

- Blender killed: the take must have its end mark and hold all received frames.
- A worker killed or frozen: it must be replaced within two seconds (on a busy machine as many times later as work takes
  longer there), the capture must go on in the same take with one marked gap and end normally. All received frames must
  be there. The time to the next pose is reported as well.

Every earlier frame must be as in an undisturbed capture, every frame with a pose that Blender had taken must be there,
no number may be missing, and no process may be left.
"""

import json
import os
import random
import select
import signal
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from perfanim.core.formats.take_file.take_reader import read_take_file
from perfanim.core.formats.take_file.take_recovery import recover
from perfanim.core.markers.marker_frame_codec import pack
from perfanim.core.worker.client import WorkerClient
from perfanim.core.worker.protocol import MessageKind
from perfanim.perfanim_addon.capture.capture_run import CaptureRun, Phase

from .processes import HELPERS, Row, children, descendants, is_running, simulated_request

VICTIMS = (
    ("solver", signal.SIGKILL),
    ("Blender", signal.SIGKILL),
    ("cameras", signal.SIGKILL),
    ("solver", signal.SIGSTOP),
    ("Blender", signal.SIGKILL),
    ("cameras", signal.SIGSTOP),
)
MOST_LOST_S = 0.5
REPLACED_S = 2.0
_SEEN = struct.Struct("<Qd")
GOES_ON = 30  # poses after a worker was replaced
LONGEST_S = 8.0  # of a capture, from its first pose on
ENDED_S = 10.0
START_LIMIT_S = 120.0


def rows(count: int, seed: int) -> Iterator[Row]:
    """Yield the row of each disturbed capture."""
    chance = random.Random(seed)  # noqa: S311 - moments, no secrets
    with tempfile.TemporaryDirectory(prefix="take-soak-") as name:
        folder = Path(name)
        request = simulated_request(folder)
        reference = _reference(request, folder / "reference.perftake")
        for number in range(count):
            path = folder / f"{number}.perftake"
            asked = {**request, "take": str(path)}
            yield _killed(asked, path, VICTIMS[number % len(VICTIMS)], chance.uniform(0.0, LONGEST_S), reference)
            path.unlink(missing_ok=True)


def stand_in(request: dict[str, Any]) -> None:
    """Take poses as Blender does, 60 times a second.

    Prints the worker's process id, a line at the first pose, and the moments at which a worker was replaced and at
    which the next pose came; a while after that, the capture is stopped. How many poses were taken stands in a file,
    and when the images of the last were in hand.
    """
    client = WorkerClient(request)
    run = CaptureRun(client)
    _say(client.process_id)
    taken = mended_at = 0
    was_mending = False
    with _count_file(request["take"]).open("wb", buffering=0) as count:
        while run.phase is not Phase.DONE:
            run.tick()
            os.pwrite(count.fileno(), _SEEN.pack(len(run.poses), run._stamp), 0)
            if run.poses and not taken:
                _say("capturing")
            is_mending = run.notice.endswith("restarting it")
            if is_mending and not was_mending:
                _say(f"{time.perf_counter()} {run.statistics.slowness}")
            if was_mending and not is_mending and len(run.poses) > taken:
                _say(time.perf_counter())
                mended_at = len(run.poses)
            was_mending = is_mending or (was_mending and not mended_at)
            taken = len(run.poses)
            if mended_at and taken > mended_at + GOES_ON and run.phase is Phase.RUNNING:
                run.stop()
            time.sleep(1 / 60)
    run.close()
    if run.error is not None:
        sys.stderr.write(f"{run.error}\n")


def _say(what: object) -> None:
    sys.stdout.write(f"{what}\n")
    sys.stdout.flush()


def _count_file(take: str) -> Path:
    return Path(take).with_suffix(".count")


def _reference(request: dict[str, Any], path: Path) -> list[bytes]:
    """Return the frames of an undisturbed capture, longer than the killed ones."""
    client = WorkerClient({**request, "take": str(path)})
    taken = 0
    while not client.ended:
        taken += sum(message.kind is MessageKind.POSE for message in client.poll())
        client.acknowledge(taken)
        if taken > 1.5 * LONGEST_S * 60:
            client.request_stop()
        client.wait(0.02)
    client.close()
    take = read_take_file(path)
    if not take.complete or len(take.frames) != taken:
        raise SystemExit(f"the reference is not whole: {take.problems}, {len(take.frames)} of {taken} frames")
    return [pack(frame) for frame in take.frames]


def _killed(
    request: dict[str, Any], path: Path, victim: tuple[str, int], after_s: float, reference: list[bytes]
) -> dict[str, Any]:
    """Return the frames kept by one capture with a process killed or frozen."""
    line = [sys.executable, "-m", "soak.takes", json.dumps(request, default=np.ndarray.tolist)]
    blender = subprocess.Popen(line, stdout=subprocess.PIPE, text=True, cwd=HELPERS)
    solver = int(_line(blender))
    _line(blender)
    time.sleep(after_s)
    (cameras,) = children(solver)
    who, how = victim
    os.kill({"solver": solver, "cameras": cameras, "Blender": blender.pid}[who], how)
    killed_s = time.perf_counter()
    sent, seen_s = _SEEN.unpack(_count_file(str(path)).read_bytes())
    family = [solver, cameras]
    replaced_s, next_pose_s, slowness = 0.0, 0.0, 1.0
    if who != "Blender":
        replaced_at_s, slowness = map(float, _line(blender).split())
        replaced_s = replaced_at_s - killed_s
        next_pose_s = float(_line(blender)) - killed_s
        family += [process_id for process_id in descendants(blender.pid) if process_id not in family]
    blender.wait()
    wrong = []
    left = _left(family)
    take = read_take_file(path)
    frames = [pack(frame) for frame in take.frames]
    numbers = [frame.number for frame in take.frames]
    kept = take.gaps[0].after + 1 if take.gaps else len(frames)
    # on a busy machine the simulated cameras may stand still: then what Blender had last is the last there was
    until_s = killed_s if killed_s - seen_s < MOST_LOST_S else seen_s
    lost_s = max(until_s - take.stamped_frames[kept - 1][0], 0.0) if kept else killed_s
    if lost_s > MOST_LOST_S:
        wrong.append("more than half a second is lost")
    if frames[:kept] != reference[:kept]:
        wrong.append("frames are not as they were")
    if numbers != list(range(len(numbers))):
        wrong.append("numbers are left out")
    if len(frames) < sent:
        wrong.append(f"{sent - len(frames)} frames with poses that Blender took are not kept")
    if not take.complete:
        wrong.append("; ".join(take.problems))
    if len(take.gaps) != (who != "Blender"):
        wrong.append(f"{len(take.gaps)} gaps are marked")
    if replaced_s > REPLACED_S * slowness:
        wrong.append("replaced too late")
    if left:
        wrong.append(f"{len(left)} processes are left")
    whole = path.with_name("whole.perftake")
    recover(take, whole)
    again = read_take_file(whole)
    if not again.complete or [pack(frame) for frame in again.frames] != frames:
        wrong.append("not recovered")
    return {"victim": who, "signal": signal.Signals(how).name, "after_s": round(after_s, 3), "sent": sent, "kept": kept,
            "frames": len(frames), "poses": len(take.poses), "replaced_s": round(replaced_s, 3),
            "next_pose_s": round(next_pose_s, 3),
            "lost_s": round(lost_s, 4), "wrong": wrong}  # fmt: skip


def _line(process: "subprocess.Popen[str]") -> str:
    if process.stdout is None or not select.select([process.stdout], [], [], START_LIMIT_S)[0]:
        raise SystemExit("the capture did not start")
    text = process.stdout.readline()
    if not text:
        raise SystemExit("the capture ended before its first pose")
    return text


def _left(processes: list[int]) -> list[int]:
    """Return the processes that still run after the time that they have to end."""
    limit_s = time.monotonic() + ENDED_S
    while True:
        running = [process_id for process_id in processes if is_running(process_id)]
        if not running or time.monotonic() > limit_s:
            return running
        time.sleep(0.05)


if __name__ == "__main__":
    stand_in(json.loads(sys.argv[1]))
