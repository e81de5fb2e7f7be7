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
        ({"fps": 1e9}, "fps must be a number from 0.1 to 1,000 frames per second; choose the source again"),
        ({"seconds": "long"}, "seconds must be a number s"),
        ({"partners": 3}, r"partners must be a list of tables \[\[partners\]\]"),
        ({"studio": [1]}, r"studio must be a table \[studio\]"),
    ],
)
def test_settings_that_nothing_can_be_made_of_are_refused_in_a_line(wrong: dict[str, Any], message: str) -> None:
    with pytest.raises(SettingsError, match=message):
        open_source({"kind": "simulated", **wrong})
