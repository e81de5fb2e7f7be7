"""Program: writers of takes at 60 frames/s, one process each, killed (SIGKILL) at the times that are given.

Arguments: folder, then seconds. Prints, a line a take, how many frames had been handed over by then.
"""

import mmap
import os
import signal
import struct
import sys
import time
from pathlib import Path

from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.formats.take_file.take_setup import TakeSetup
from perfanim.core.formats.take_file.take_writer import TakeWriter
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.subject import Subject
from perfanim.core.simulate.studio.studio_rig import default_rig

sys.path.insert(0, str(Path(__file__).parents[3] / "helpers"))

from records import frame_record, pose_record

FPS = 60
RECORDS = 300


def main(folder: Path, times_s: list[float]) -> None:
    subject = Subject("Anna", default_skeleton(1.7), load_marker_set("boxing"))
    setup = TakeSetup.of(default_rig(), (subject,), {}, {}, {})
    records = [(frame_record(number), pose_record(number)) for number in range(RECORDS)]
    handed_over = mmap.mmap(-1, 8 * len(times_s))
    begun_s = time.perf_counter()
    children = []
    for number in range(len(times_s)):
        child = os.fork()
        if child == 0:
            write(folder / f"{number}.perftake", setup, records, handed_over, number)
        children.append(child)
    for limit_s, child in sorted(zip(times_s, children, strict=True)):
        time.sleep(max(begun_s + limit_s - time.perf_counter(), 0.0))
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
    for number in range(len(times_s)):
        sys.stdout.write(f"{struct.unpack_from('<Q', handed_over, 8 * number)[0]}\n")


def write(path: Path, setup: TakeSetup, records: list[tuple[bytes, bytes]], handed_over: mmap.mmap, slot: int) -> None:
    writer = TakeWriter(path, setup)
    for number, (frame, pose) in enumerate(records, start=1):
        writer.add_frame(frame)
        writer.add_pose(pose)
        struct.pack_into("<Q", handed_over, 8 * slot, number)
        time.sleep(1.0 / FPS)
    time.sleep(3600.0)


if __name__ == "__main__":
    main(Path(sys.argv[1]), [float(text) for text in sys.argv[2:]])
