"""What of a source a process that takes another's place must not hand over again."""

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from perfanim.core.vision.sources.image_set import ImageSet
from perfanim.core.worker.jobs.camera_frames import _remaining
from perfanim.core.worker.source_traits import is_live, is_repeatable, is_simulated

IMAGE = (np.zeros((4, 4, 3), np.uint8),)


def of(kind: str, **source: Any) -> dict[str, Any]:
    return {"source": {"kind": kind, **source}}


def test_files_and_the_simulated_performer_can_be_read_again(tmp_path: Path) -> None:
    (tmp_path / "left.mp4").touch()
    kinds = {
        "cameras": of("cameras", devices=[0, 1]),
        "stream": of("videos", paths=["rtsp://somewhere/1"]),
        "played by the clock": of("simulated", live=True),
        "video": of("videos", paths=[str(tmp_path / "left.mp4")]),
        "pattern": of("images", paths=[str(tmp_path / "left*.png")]),
        "simulated": of("simulated"),
    }
    assert [name for name, asked in kinds.items() if is_repeatable(asked)] == ["video", "pattern", "simulated"]
    assert [name for name, asked in kinds.items() if is_live(asked)] == ["cameras", "stream"]
    assert [name for name, asked in kinds.items() if is_simulated(asked)] == ["played by the clock", "simulated"]


def test_what_was_handed_over_is_passed_over(tmp_path: Path) -> None:
    sets = [ImageSet(number, (number / 60,), IMAGE) for number in (0, 1, 2, 4, 5, 6)]
    asked = of("images", paths=[str(tmp_path)])
    assert [one.number for one in _remaining(asked, sets)] == [0, 1, 2, 4, 5, 6]
    assert [one.number for one in _remaining({**asked, "after": {"number": 3}}, sets)] == [4, 5, 6]
    assert [one.number for one in _remaining({**of("cameras"), "after": {"number": 3}}, sets)] == [0, 1, 2, 4, 5, 6]
    performer = SimpleNamespace(first=0)
    _remaining({**of("simulated"), "after": {"number": 41}}, performer)
    assert performer.first == 42
