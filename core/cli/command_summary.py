"""Summaries that commands return, as JSON and as lines for people."""

import math
from typing import Any

_MOST_ROWS = 60  # rows of a report, or names in a list, that are shown


class PartialResult(dict[str, Any]):
    """Summary of work that may have failed in part.

    Args:
        summary: Figures, for JSON.
        text: Lines for a person.
        failure: One line for stderr, which makes the exit status 1; "" if nothing failed.
    """

    def __init__(self, summary: dict[str, Any], text: str, failure: str = "") -> None:
        super().__init__(summary)
        self.text = text
        self.failure = failure


def jsonable(value: Any) -> Any:
    """Return the value with numpy scalars and arrays as plain ones and NaN as null."""
    if isinstance(value, dict):
        return {str(key): jsonable(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [jsonable(item) for item in value]
    if hasattr(value, "tolist"):
        return jsonable(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value if value is None or isinstance(value, bool | int | float | str) else str(value)


def summary_text(summary: dict[str, Any]) -> str:
    """Return the summary for people, one line per figure and per row of a report; long lines are cut."""
    return "\n".join(
        line for key, value in jsonable(summary).items() for line in _figure_lines(key.replace("_", " "), value)
    )


def _figure_lines(label: str, value: Any) -> list[str]:
    if isinstance(value, dict | list) and not value:
        return [f"{label}: none"]
    if isinstance(value, dict) and all(isinstance(row, dict) for row in value.values()):
        return [f"{label}:", *_cut_rows([f"{name}: {_short(row)}" for name, row in value.items()])]
    if isinstance(value, dict):
        parts = [f"{name} {_short(item)}" for name, item in value.items()]
        return [f"{label}: " + ", ".join(parts[:12] + [f"and {len(parts) - 12} more, see --json"] * (len(parts) > 12))]
    if isinstance(value, list) and all(isinstance(row, dict) for row in value):
        # empty values are left out of rows, but not a time of 0.0
        rows = [[_row_value(*item) for item in row.items() if item[1] or isinstance(item[1], float)] for row in value]
        return [f"{label}: {len(value)}", *_cut_rows([", ".join(row) for row in rows])]
    if isinstance(value, list) and len(value) > 12 and not isinstance(value[0], str):
        return [f"{label}: {len(value)}"]
    if isinstance(value, list):
        more = f", and {len(value) - _MOST_ROWS} more, see --json" if len(value) > _MOST_ROWS else ""
        return [f"{label}: {', '.join(map(_short, value[:_MOST_ROWS]))}{more}"]
    return [f"{label}: {_short(value)}"]


def _cut_rows(rows: list[str]) -> list[str]:
    shown = [f"  {row}" for row in rows[:_MOST_ROWS]]
    return [*shown, f"  and {len(rows) - _MOST_ROWS} more, see --json"] if len(rows) > _MOST_ROWS else shown


def _row_value(key: str, value: Any) -> str:
    """Return a value of a row; fractional numbers and tables are shown with their name."""
    return f"{key.replace('_', ' ')} {_short(value)}" if isinstance(value, float | dict) else _short(value)


def _short(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, dict):
        return " ".join(f"{key}={_short(item)}" for key, item in value.items() if item is not None)
    return "; ".join(map(_short, value)) if isinstance(value, list) else str(value)
