"""Figures as JSON and CSV."""

import csv
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ...system.files import atomic_path


def write_json(path: Path, figures: dict[str, Any]) -> None:
    """Write figures as JSON."""
    with atomic_path(path) as temporary:
        temporary.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")


def write_rows(path: Path, rows: Sequence[dict[str, Any]]) -> None:
    """Write rows of equal keys as CSV, the keys as its first line."""
    with atomic_path(path) as temporary, temporary.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
