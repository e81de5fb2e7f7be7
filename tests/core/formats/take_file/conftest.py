"""A small take with everything in it."""

from collections.abc import Callable
from pathlib import Path

import pytest
from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.formats.take_file import take_writer as writer_module
from perfanim.core.formats.take_file.take_setup import TakeNotes, TakeSetup
from perfanim.core.formats.take_file.take_writer import TakeWriter, WriterSettings
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.subject import Subject
from perfanim.core.simulate.studio.studio_rig import default_rig
from records import frame_record, pose_record


@pytest.fixture(scope="session")
def setup() -> TakeSetup:
    subject = Subject("Anna", default_skeleton(1.7), load_marker_set("boxing"))
    database = {"path": "motion.perfdb", "frames": 1234, "fps": 60.0, "sha256": "00ff"}
    return TakeSetup.of(default_rig(), (subject,), {"method": "lwr"}, database, {"source": {"kind": "cameras"}})


@pytest.fixture(scope="session")
def write(setup: TakeSetup) -> Callable[..., Path]:
    """write(path, frames, every): a whole take of so many frames, `every` of them a chunk."""

    def make(path: Path, frames: int = 12, every: int = 3) -> Path:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(writer_module, "SETTINGS", WriterSettings(write_every_s=3600.0))  # this plays the thread
            writer = TakeWriter(path, setup, TakeNotes("Walk 1"))
            for start in range(0, frames, every):
                for number in range(start, min(start + every, frames)):
                    writer.add_frame(frame_record(number))
                    writer.add_pose(pose_record(number))
                writer._collect()
            writer.close()
        return path

    return make
