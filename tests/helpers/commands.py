"""Commands as users give them, in the test's process."""

import json
from typing import Any

import pytest
from perfanim.core.cli.main import main


def run(capsys: pytest.CaptureFixture[str], *line: object) -> Any:
    """Return what a command that succeeds tells."""
    capsys.readouterr()
    assert main([*map(str, line), "--json"]) == 0
    return json.loads(capsys.readouterr().out)
