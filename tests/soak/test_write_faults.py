"""Processes that write are killed, or get no more disk, at a few moments."""

import sys

import pytest

if sys.platform == "win32":
    pytest.skip("a kill is a signal", allow_module_level=True)

from soak.writes import FULL, KILLED
from soak.writes import rows as disturbed_works


@pytest.mark.long
def test_nothing_that_stood_before_is_lost() -> None:
    rows = list(disturbed_works(15, 1))
    assert [row for row in rows if row["wrong"]] == []
    assert {(row["work"], row["fault"]) for row in rows} >= {
        (work, KILLED) for work in ("record", "build", "notes", "export")
    }
    assert sum(row["fault"] == FULL for row in rows) == 3
