"""Processes that write are killed, or get no more disk, at a few moments."""

import sys

import pytest

if sys.platform == "win32":
    pytest.skip("a kill is a signal", allow_module_level=True)

from write_faults import FULL, KILLED, campaign


def test_nothing_that_stood_before_is_lost() -> None:
    rows = campaign(15, 1, lambda row: None)
    assert [row for row in rows if row["wrong"]] == []
    assert {(row["work"], row["fault"]) for row in rows} >= {
        (work, KILLED) for work in ("record", "build", "notes", "export")
    }
    assert sum(row["fault"] == FULL for row in rows) == 3
