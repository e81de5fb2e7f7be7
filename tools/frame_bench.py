"""Time of one live frame in the extension, from packet to the character's bones.

    python tools/frame_bench.py --data DIR [--database ALL.pfdb] [--character Xbot.glb]

Runs in one process, one after the other, the work of solver process and Blender on each frame: decode the packet,
write the take, solve, pack, send as bytes, unpack, pose the armature. Excluded: cameras, waiting for sockets,
Blender's own evaluation and drawing. The database is cut to as many frames as `perfanim bench speed` takes, without
the takes it solves. DIR holds cmu/ (and bandai/, to build the database from both). Times are wall and processor time,
beside those of one exhaustive NumPy search, as machines differ, and of the solver alone. Run it with
OPENBLAS_NUM_THREADS=1 like the worker (`make frame-bench` does). The exit status is 1 if the median is above 4 ms or
the 99th percentile above 8.
"""

import argparse
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np
from bench.data import BOXING, FPS, WALKING, read_take, whole_database
from bench.speed import part_of, reference_ms
from perfanim.core.body.motion import Motion
from perfanim.core.database.store import Database, identity, open_database
from perfanim.core.formats.take_file.pose_codec import TimedPose, pack_solved
from perfanim.core.formats.take_file.take_setup import TakeSetup
from perfanim.core.formats.take_file.take_writer import TakeWriter
from perfanim.core.geometry.arrays import Array
from perfanim.core.markers.marker_frame_codec import pack_stamped, unpack_stamped
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.subject import Subject
from perfanim.core.markers.take_frames import take_frames
from perfanim.core.session.multi_target_session import MultiTargetSession
from perfanim.core.session.session import Session
from perfanim.core.simulate.simulated_markers import simulate_markers
from perfanim.core.simulate.studio.studio_rig import default_rig
from perfanim.core.worker.protocol import Decoder, MessageKind, encode
from perfanim.perfanim_addon.capture.armature_driver import ArmatureDriver
from perfanim.perfanim_addon.character.create_character import create_character

MEDIAN_MS, P99_MS = 4.0, 8.0
PROCESSES = 2


def main() -> int:
    """Run; the exit status is 1 when it takes longer than is asked."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="folder that holds cmu (and bandai)")
    parser.add_argument("--database", type=Path, help="all motion, already built (default: built from --data)")
    parser.add_argument("--character", type=Path, help="a .glb character besides the product's own")
    options = parser.parse_args()
    missed = False
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        whole = (
            open_database(options.database)
            if options.database
            else whole_database(options.data, folder, ("cmu", "bandai"), PROCESSES, lambda fraction, text: None)
        )
        database = part_of(whole, folder / "part.pfdb")
        wall, processor = reference_ms()
        _say(f"{database.frames:,} frames; one exhaustive search {wall:.1f} ms, {processor:.1f} of the processor")
        for take in (WALKING, BOXING):
            motion = read_take(options.data, take)
            for title, character in _characters(motion, options.character):
                taken = 1e3 * np.array(_taken(motion, database, character, folder / f"{take.trial} {title}.perftake"))
                missed |= _report(f"{take.title}, {title}", taken, (wall, processor, wall))
    return int(missed)


def _characters(motion: Motion, file: Path | None) -> list[tuple[str, str]]:
    """Add the performer and a file's character to an empty scene; return both names."""
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    found = [("own character", create_character(bpy.context, motion.skeleton))]
    if file is not None:
        known = set(bpy.data.objects)
        bpy.ops.import_scene.gltf(filepath=str(file))
        armature = next(obj for obj in set(bpy.data.objects) - known if obj.type == "ARMATURE")
        found.append((file.stem, armature.name))
    return found


def _taken(motion: Motion, database: Database, character: str, path: Path) -> list[tuple[float, float, float]]:
    """Return each frame's wall and processor seconds, and the solver's wall seconds."""
    subject = Subject(motion.name, motion.skeleton, load_marker_set("boxing"))
    frames = take_frames(simulate_markers(motion, subject)[0], subject.marker_set)
    packets = [pack_stamped(number / FPS, frame) for number, frame in enumerate(frames)]
    session = MultiTargetSession([Session(subject, database)])
    driver = ArmatureDriver(character, motion.skeleton)
    setup = TakeSetup.of(default_rig(), (subject,), {}, identity(database), {"source": {"kind": "simulated"}})
    take, decoder = TakeWriter(path, setup), Decoder()
    handle = _handled(session, driver, take, decoder)
    taken = []
    for packet in packets:
        wall_s, processor_s = time.perf_counter(), time.process_time()
        solver_s = handle(packet)
        taken.append((time.perf_counter() - wall_s, time.process_time() - processor_s, solver_s))
    take.close()
    return taken


def _handled(
    session: MultiTargetSession, driver: ArmatureDriver, take: TakeWriter, decoder: Decoder
) -> Callable[[bytes], float]:
    """Return a packet handler that returns the solver's seconds."""

    def handle(packet: bytes) -> float:
        take.add_frame(packet)
        stamp_s, frame = unpack_stamped(packet)
        started_s = time.perf_counter()
        pose = session.step(frame)
        solver_s = time.perf_counter() - started_s
        record = pack_solved(TimedPose(pose, stamp_s, solver_s))
        take.add_pose(record)
        (message,) = decoder.feed(encode(MessageKind.POSE, record))
        (shown,) = message.pose().pose.performers
        driver.apply(shown.rotations, shown.root_position_m)
        return solver_s

    return handle


def _report(title: str, taken: Array, reference: tuple[float, float, float]) -> bool:
    """Say how long it took; return whether that is longer than is asked by the clock."""
    _say(f"{title}, {len(taken)} frames:")
    for what, milliseconds, search in zip(("clock", "processor", "the solver alone"), taken.T, reference, strict=True):
        median, p99 = float(np.median(milliseconds)), float(np.percentile(milliseconds, 99))
        ratios = f"{median / search:.3f}, {p99 / search:.3f} of the search"
        _say(f"  {what}: median {median:.2f} ms, p99 {p99:.2f} ms ({ratios})")
    return bool(np.median(taken[:, 0]) > MEDIAN_MS or np.percentile(taken[:, 0], 99) > P99_MS)


def _say(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main())
