"""HTML report of a batch: all takes on one page, in one file, bad takes first."""

import base64
from collections.abc import Sequence
from html import escape
from pathlib import Path
from urllib.parse import quote

from ...errors import FormatError, counted
from ...system.assets import BATCH_STYLE
from ...system.files import read_bytes
from .quality import LEAST_CONFIDENCE, LIMITS
from .take_record import BAD, DOUBTFUL, GOOD, Record

_ORDER = (BAD, DOUBTFUL, GOOD)
_MOST = {limit.figure: limit.most for limit in LIMITS}
_COLUMNS = (
    ("frames", "frames", "{:.0f}"),
    ("marker_rms_mm", "marker error, mm", "{:.1f}"),
    ("confidence", "confidence", "{:.0%}"),
    ("hidden", "hidden", "{:.1%}"),
    ("longest_gap_s", "longest gap, s", "{:.2f}"),
    ("foot_skate_cm_s", "foot skate, cm/s", "{:.0f}"),
)
_MOST_BYTES = 4 << 20  # largest size of a picture, bytes
_STYLE = "\n" + BATCH_STYLE.read_text(encoding="utf-8")


def page_text(records: Sequence[Record], out: Path) -> str:
    """Return the page (HTML); its only external references are the motion files."""
    takes = counted(len(records), "take")
    statuses = ", ".join(f"{sum(r.status == status for r in records)} {status}" for status in _ORDER)
    heads = "".join(f"<th>{title}</th>" for _, title, _ in _COLUMNS)
    ordered = sorted(records, key=lambda record: (_ORDER.index(record.status), record.name))
    rows = "\n".join(_row(record, out) for record in ordered)
    return f"""<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><title>Batch of {takes}</title><style>{_STYLE}</style></head>
<body><h1>{takes}: {statuses}</h1>
<p>The bar below the poses is the take's timeline: green where the confidence is high, red where it is low, black where
there is no pose.</p>
<table><tr><th>take</th>{heads}<th>poses</th></tr>
{rows}
</table></body></html>
"""


def _row(record: Record, out: Path) -> str:
    motion = record.outputs.get("character") or record.outputs.get("motion")
    name = escape(record.name)
    if motion:  # a file name need not be valid Unicode
        name = f'<a href="{quote(motion, errors="surrogateescape")}">{name}</a>'
    notes = [f'<div class="reason">{escape(reason)}</div>' for reason in record.reasons]
    notes += [f'<div class="warning">{escape(warning)}</div>' for warning in record.warnings]
    cells = "".join(_cell(record, figure, pattern) for figure, _, pattern in _COLUMNS)
    first = name + "".join(notes)
    return f'<tr class="{record.status}"><td>{first}</td>{cells}<td>{_picture(record, out)}</td></tr>'


def _cell(record: Record, figure: str, pattern: str) -> str:
    value = record.figures.get(figure)
    if value is None:
        return "<td></td>"
    stands_out = value < LEAST_CONFIDENCE if figure == "confidence" else value > _MOST.get(figure, float("inf"))
    kind = ' class="out"' if stands_out else ""
    return f"<td{kind}>{pattern.format(value)}</td>"


def _picture(record: Record, out: Path) -> str:
    if "picture" not in record.outputs:
        return ""
    try:
        data = base64.b64encode(read_bytes(out / record.outputs["picture"], _MOST_BYTES)).decode()
    except FormatError:  # another program has changed the picture, so the page omits it
        return ""
    return f'<img loading="lazy" alt="poses of {escape(record.name, quote=True)}" src="data:image/jpeg;base64,{data}">'
