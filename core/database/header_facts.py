"""Contents of a database's JSON header."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import lru_cache
from pathlib import Path
from typing import Annotated

from ..errors import DatabaseError
from ..system.schema import About, Schema
from .skeleton_facts import REBUILD, BodyTable

SLOWEST, FASTEST = 1.0, 2000.0  # frames per second
_MOST = 1e15  # largest valid number of bytes or rows


@dataclass(frozen=True)
class Clip:
    """Clip of the database: frames from `start` to before `stop`.

    A file with gaps or jumps yields several clips of the same name.
    """

    name: Annotated[str, About("name of the file")]
    behaviour: Annotated[str, About('action, such as "walk"; empty if unknown')]
    subject: Annotated[str, About("recorded person; empty if unknown")]
    source_fps: Annotated[float, About("rate of the file", "frames per second", 1e-3, 1e6)]
    start: Annotated[int, About("first frame", "", 0, _MOST)]
    stop: Annotated[int, About("frame after the last one", "", 0, _MOST)]
    skeleton: Annotated[int, About("index of the skeleton", "", 0, _MOST)]
    first_frame: Annotated[int, About("first frame in the file, counted from 0", "", 0, _MOST)] = 0
    mirrored: Annotated[bool, About("whether the clip is a mirror image of the recording")] = False

    def part(self, first: int, stop: int, start: int, fps: float) -> "Clip":
        """Return a part of the clip as a clip of a new database.

        Args:
            first: First frame of the part, counted from the start of this clip at the database's rate.
            stop: Frame after the part's last one, counted in the same way.
            start: Frame of the new database at which the part begins.
            fps: Frame rate of the database.
        """
        before = round(first * self.source_fps / fps)
        return replace(self, start=start, stop=start + stop - first, first_frame=self.first_frame + before)


@dataclass(frozen=True)
class ReferenceOwner:
    """Subject whose clips share a reference pose of their own."""

    subject: Annotated[str, About("recorded person")]
    skeleton: Annotated[int, About("index of the skeleton", "", 0, _MOST)]
    mirrored: Annotated[bool, About("whether the clips are mirror images")]


@dataclass(frozen=True)
class ArrayPlace:
    """Position of an array in the file."""

    dtype: Annotated[str, About("NumPy's name of the type")]
    shape: Annotated[tuple[int, ...], About("length of each axis", "", 0, _MOST)]
    offset: Annotated[int, About("distance from the start of the first array", "bytes", 0, _MOST)]
    crc32: Annotated[int | None, About("checksum", "", 0, 2**32 - 1)] = None


@dataclass(frozen=True)
class Header:
    """Contents of a database's header."""

    fps: Annotated[float, About("rate of all frames", "frames per second", SLOWEST, FASTEST)]
    joints: Annotated[tuple[str, ...], About("names of the joints")]
    clips: Annotated[tuple[Clip, ...], About("clips, in the order of their frames")]
    skeletons: Annotated[tuple[BodyTable, ...], About("skeletons of the subjects")]
    arrays: Annotated[Mapping[str, ArrayPlace], About("positions of the arrays")]
    culled_frames: Annotated[int, About("near-duplicates left out when the database was built", "", 0, _MOST)] = 0
    reference_owners: Annotated[
        tuple[ReferenceOwner, ...], About("subjects with a reference pose of their own", key="zeros")
    ] = ()


FACTS = Schema(Header, "Header of a database", "JSON at the beginning of the file.", DatabaseError, REBUILD)


@lru_cache(maxsize=1)  # every new solver reads the same header again
def read_header(path: Path, header: bytes) -> Header:
    """Return the contents of a header.

    Raises:
        DatabaseError: The header does not fit the schema.
    """
    facts = json.loads(header)
    if not isinstance(facts, dict):
        raise ValueError("its header is not a JSON object")
    rows, names = facts.get("zeros"), [each.name for each in fields(ReferenceOwner)]
    if isinstance(rows, list):
        facts["zeros"] = [dict(zip(names, row, strict=False)) if isinstance(row, list) else row for row in rows]
    return FACTS.read(facts, str(path))
