"""Figures as JSON and CSV."""

import csv
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from perfanim.core.system.files import atomic_path

Rows = Sequence[dict[str, Any]]


def write_figures(
    out: Path, bench: str, figures: dict[str, Any], tables: Mapping[str, Rows], plots: Sequence[Path] = ()
) -> dict[str, Any]:
    """Write figures as JSON and tables as CSV; return the figures with the paths.

    Args:
        tables: rows of equal keys by the end of the file's name, "" for the bench's own.
    """
    path = out / f"{bench}.json"
    with atomic_path(path) as temporary:
        temporary.write_text(json.dumps(figures, indent=1) + "\n", encoding="utf-8")
    paths = [path]
    for name, rows in tables.items():
        paths.append(out / (f"{bench}-{name}.csv" if name else f"{bench}.csv"))
        with atomic_path(paths[-1]) as temporary, temporary.open("w", newline="", encoding="utf-8") as stream:
            writer = csv.DictWriter(stream, list(rows[0]))
            writer.writeheader()
            writer.writerows(rows)
    return figures | {"outputs": [str(each) for each in (*paths, *plots)]}
