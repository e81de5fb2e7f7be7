"""Each way in which a camera can fail: reported, done without, over."""

import random

import pytest
from soak.cameras import FAULTS, failed


@pytest.mark.long
@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_reported_and_ends(fault: str) -> None:
    row = failed(fault, random.Random(1))  # noqa: S311 - moments, no secrets
    assert row["note"].startswith("the right camera ")
    assert row["recovered_s"] < float("inf")
    assert row["used"] > 0.0
