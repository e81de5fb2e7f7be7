"""What of a source a process that takes another's place must not hand over again."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from perfanim.core.simulate.studio.simulated_performer import SimulatedPerformer
from perfanim.core.vision.sources.image_set import ImageSet
from perfanim.core.vision.sources.source_requests import ImageFiles, LiveCameras, VideoFiles
from perfanim.core.worker.jobs.camera_frames import _remaining
from perfanim.core.worker.requests import CamerasRequest, TrackerSource
from perfanim.core.worker.restart_point import RestartPoint

IMAGE = (np.zeros((4, 4, 3), np.uint8),)


def test_files_and_the_simulated_performer_can_be_read_again(tmp_path: Path) -> None:
    (tmp_path / "left.mp4").touch()
    kinds = {
        "cameras": LiveCameras((0, 1)),
        "trackers": TrackerSource(39540),
        "stream": VideoFiles(("rtsp://somewhere/1",)),
        "played by the clock": SimulatedPerformer(live=True),
        "video": VideoFiles((str(tmp_path / "left.mp4"),)),
        "pattern": ImageFiles((str(tmp_path / "left*.png"),)),
        "simulated": SimulatedPerformer(),
    }
    assert [name for name, source in kinds.items() if source.is_repeatable] == ["video", "pattern", "simulated"]
    assert [name for name, source in kinds.items() if source.is_live] == ["cameras", "trackers", "stream"]


def test_what_was_handed_over_is_passed_over(tmp_path: Path) -> None:
    sets = [ImageSet(number, (number / 60,), IMAGE) for number in (0, 1, 2, 4, 5, 6)]
    asked, after = CamerasRequest(source=ImageFiles((str(tmp_path),))), RestartPoint(3, 0.05, 1.0)
    assert [one.number for one in _remaining(asked, sets)] == [0, 1, 2, 4, 5, 6]
    assert [one.number for one in _remaining(replace(asked, after=after), sets)] == [4, 5, 6]
    live = CamerasRequest(source=LiveCameras((0, 1)), after=after)
    assert [one.number for one in _remaining(live, sets)] == [0, 1, 2, 4, 5, 6]
    performer = SimpleNamespace(first=0)
    _remaining(CamerasRequest(source=SimulatedPerformer(), after=replace(after, number=41)), performer)
    assert performer.first == 42
