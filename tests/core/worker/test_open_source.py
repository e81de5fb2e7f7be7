"""Descriptions of image sources: text of another process, so any value may be of any type."""

from typing import Any

import pytest
from perfanim.core.errors import SettingsError
from perfanim.core.worker.open_source import open_source


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"behaviour": "walking", "seconds": 1e12}, "too long"),
        ({"poses": ["t"], "held_s": 1e12}, "held"),
        ({"poses": ["t"] * 1000}, "held"),
        ({"partners": [{}] * 1000}, "1000 partners"),
        ({"fps": 1e9}, "frame rate"),
        ({"seconds": "long"}, "setting of the image source"),
        ({"partners": 3}, "setting of the image source"),
        ({"studio": [1]}, "setting of the image source"),
    ],
)
def test_settings_that_nothing_can_be_made_of_are_refused_in_a_line(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(SettingsError, match=message):
        open_source({"kind": "simulated", **wrong})
