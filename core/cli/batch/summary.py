"""Summary of a batch: a table (CSV), JSON, and a page with pictures."""

import csv
import json
from collections.abc import Sequence
from io import StringIO
from pathlib import Path
from typing import Any

from .html_report import page_text
from .plan import SUMMARY
from .take_record import BAD, DOUBTFUL, GOOD, Record

_FIGURES = ("frames", "marker_rms_mm", "confidence", "hidden", "longest_gap_s", "foot_skate_cm_s")
_HEADS = ("frames", "error mm", "confid.", "hidden", "gap s", "skate cm/s")
_LONGEST = 36  # longest name in the table for people, characters


def write_summary(records: Sequence[Record], out: Path, work: Path) -> Path:
    """Write summary.csv, summary.json and summary.html; return the page."""
    texts = {
        SUMMARY: _table(records),
        "summary.json": json.dumps(counts(records) | {"takes": [facts(record) for record in records]}, indent=1) + "\n",
        "summary.html": page_text(records, out),
    }
    for name, text in texts.items():
        # file names need not be valid Unicode
        (work / name).write_text(text, encoding="utf-8", errors="backslashreplace", newline="\n")
        (work / name).replace(out / name)
    return out / "summary.html"


def counts(records: Sequence[Record]) -> dict[str, int]:
    """Return how many takes are good, doubtful and bad."""
    return {status: sum(record.status == status for record in records) for status in (GOOD, DOUBTFUL, BAD)}


def facts(record: Record) -> dict[str, Any]:
    """Return the facts about a take."""
    return {
        "name": record.name,
        "take": record.source,
        "status": record.status,
        "reasons": list(record.reasons),
        "warnings": list(record.warnings),
        "figures": record.figures,
        "outputs": record.outputs,
    }


def text_table(records: Sequence[Record]) -> str:
    """Return the takes as a table for a terminal."""
    rows: list[tuple[str, ...]] = [("take", "", *_HEADS, "")]
    for record in records:
        values = [_number(record.figures.get(figure)) for figure in _FIGURES]
        name = record.name if len(record.name) <= _LONGEST else record.name[: _LONGEST - 3] + "..."
        rows.append((name, record.status, *values, "; ".join(record.reasons)))
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    lines = []
    for row in rows:
        cells = [text.ljust(widths[i]) if i < 2 else text.rjust(widths[i]) for i, text in enumerate(row[:-1])]
        lines.append("  ".join((*cells, row[-1])).rstrip())
    return "\n".join(lines)


def _table(records: Sequence[Record]) -> str:
    names = list(dict.fromkeys(name for record in records for name in record.figures))
    file = StringIO()
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(["name", "take", "status", "reasons", *names])
    for record in records:
        values = [record.figures.get(name) for name in names]
        writer.writerow([record.name, record.source, record.status, "; ".join(record.reasons), *values])
    return file.getvalue()


def _number(value: float | int | None) -> str:
    return "" if value is None else str(value) if isinstance(value, int) else f"{value:.2f}"
