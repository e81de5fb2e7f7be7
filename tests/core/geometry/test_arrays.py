import numpy as np
import pytest
from perfanim.core.geometry.arrays import runs


@pytest.mark.parametrize(
    ("flags", "found"),
    [("", []), ("000", []), ("1", [(0, 1)]), ("0110111", [(1, 3), (4, 7)]), ("1001", [(0, 1), (3, 4)])],
)
def test_runs(flags: str, found: list[tuple[int, int]]) -> None:
    assert runs(np.array([flag == "1" for flag in flags], dtype=bool)) == found
