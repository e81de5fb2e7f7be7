"""Schema of the facts in a database's header."""

import json
from pathlib import Path
from typing import Any

from ..errors import DatabaseError
from ..system.schema import Key, Schema
from .skeleton_facts import BODY

REBUILD = "build it again with `perfanim database build`, or import the motion again"
SLOWEST, FASTEST = 1.0, 2000.0  # frames per second
_MOST = 1e15  # bytes, rows
CLIP = (
    Key("name", "of the file", str),
    Key("behaviour", "action", str),
    Key("subject", "recorded person", str),
    Key("source_fps", "rate of the file", float, (), "frames per second", 1e-3, 1e6),
    Key("start", "first frame", int, (), "", 0, _MOST),
    Key("stop", "frame after the last one", int, (), "", 0, _MOST),
    Key("skeleton", "body", int, (), "", 0, _MOST),
    Key("first_frame", "of the file", int, (), "", 0, _MOST, optional=True),
    Key("mirrored", "whether it is a mirror image", bool, optional=True),
)
REFERENCE_POSE = (
    Key("subject", "recorded person", str),
    Key("skeleton", "body", int, (), "", 0, _MOST),
    Key("mirrored", "whether it is of mirror images", bool),
)
_ARRAY = (
    Key("dtype", "numpy's name of the type", str),
    Key("shape", "rows and columns", int, (None,), "", 0, _MOST),
    Key("offset", "from the first array", int, (), "bytes", 0, _MOST),
    Key("crc32", "checksum", int, (), "", 0, 2**32 - 1, optional=True),
)
FACTS = Schema(
    "Header of a database",
    "JSON at the beginning of the file.",
    (
        Key("fps", "rate of all frames", float, (), "frames per second", SLOWEST, FASTEST),
        Key("joints", "names", str, (None,)),
        Key("clips", "clips, in the order of their frames", CLIP, (None,)),
        Key("skeletons", "bodies", BODY, (None,)),
        Key("arrays", "places of the arrays", _ARRAY, named=True),
        Key("culled_frames", "left out when it was built", int, (), "", 0, _MOST, optional=True),
        Key("zeros", "subjects with a reference pose of their own", REFERENCE_POSE, (None,), optional=True),
    ),
    DatabaseError,
    REBUILD,
)


def read_facts(path: Path, header: bytes) -> dict[str, Any]:
    """Return the facts of a header; rows of reference poses become tables.

    Raises:
        DatabaseError: they do not fit the schema.
    """
    facts = json.loads(header)
    if not isinstance(facts, dict):
        raise ValueError("its header is not a table")
    rows, names = facts.get("zeros"), [key.name for key in REFERENCE_POSE]
    if isinstance(rows, list):
        facts["zeros"] = [dict(zip(names, row, strict=False)) if isinstance(row, list) else row for row in rows]
    FACTS.check(facts, str(path))
    return facts
