"""Records of a batch's takes, and tasks for its processes.

This module loads nothing for solving or drawing, so that the process that distributes the takes starts fast.
"""

import errno
import json
import os
from collections.abc import Iterable, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated

from ...errors import FormatError
from ...system.files import read_bytes, reading
from ...system.schema import About, Schema, table_of
from .content_hash import file_digest
from .plan import ALSO, MOST_RECORD_BYTES, REPORT, SAVED_AS, TakePlan

GOOD, DOUBTFUL, BAD = "good", "doubtful", "bad"

_ENDINGS = ("bvh", "take.npz", *ALSO, *SAVED_AS)
_TEMPORARY = ".{}.angles.12345678.csv"  # the longest name of a take's file while it is written


@dataclass(frozen=True)
class Record:
    """Record of a take, stored next to its outputs."""

    name: Annotated[str, About("name of the take", least=1)]
    source: Annotated[str, About("the take as its plan names it")]
    digest: Annotated[str, About("hash of all that the results depend on")]
    status: Annotated[str, About("result", choices=(GOOD, DOUBTFUL, BAD))]
    reasons: Annotated[tuple[str, ...], About("why it is doubtful or bad", optional=False)] = ()
    warnings: Annotated[tuple[str, ...], About("warnings of its commands", optional=False)] = ()
    figures: Annotated[Mapping[str, int | float | None], About("quality figures", optional=False)] = field(
        default_factory=dict
    )
    outputs: Annotated[Mapping[str, str], About("kind and file of each result", optional=False)] = field(
        default_factory=dict
    )
    sha256: Annotated[dict[str, str], About("file and digest of each result", least=1, optional=False)] = field(
        default_factory=dict
    )
    is_kept: Annotated[bool, About("whether a later run skips the take", optional=False)] = True

    @classmethod
    def of_text(cls, text: str) -> "Record":
        """Return the record from a JSON object; FormatError if it is not one."""
        with reading("record"):
            return _RECORD.read(json.loads(text), "record")

    def text(self) -> str:
        """Return the record as a JSON object on one line."""
        return json.dumps(table_of(self), sort_keys=True)


_RECORD = Schema(
    Record, "Record of a take", "Kept by `perfanim batch` beside a take's results.", FormatError, closed=True
)


@dataclass(frozen=True)
class Task:
    """One take to process, as it is sent to another process.

    Args:
        work: Folder below which unfinished files are written.
    """

    take: TakePlan
    out: str
    work: str

    @classmethod
    def of_text(cls, text: str) -> "Task":
        """Return the task from a JSON object."""
        table = json.loads(text)
        return cls(TakePlan(**table["take"]), table["out"], table["work"])

    def text(self) -> str:
        """Return the task as a JSON object on one line."""
        return json.dumps(asdict(self))


def record_path(out: Path, name: str) -> Path:
    """Return the path of a take's record."""
    return out / REPORT / f"{name}.json"


def finished_record(take: TakePlan, out: Path) -> Record | None:
    """Return the record of an earlier run if inputs and outputs are unchanged, else None."""
    record = stored_record(take.name, out)
    if record is None or not record.is_kept or record.digest != take.digest:
        return None
    if any(file_digest(out / file) != digest for file, digest in record.sha256.items()):
        return None
    return record


def stored_record(name: str, out: Path) -> Record | None:
    """Return an earlier run's record of a take, or None if it cannot be read.

    The file may come from anyone: a record that names files other than the take's own is ignored.
    """
    try:
        record = Record.of_text(read_bytes(record_path(out, name), MOST_RECORD_BYTES).decode("utf-8"))
    except (FormatError, ValueError):
        return None
    files = set(record.outputs.values())
    is_own = record.name == name and files == set(record.sha256) and _are_own(name, files, out)
    return record if is_own else None


def _are_own(name: str, files: Iterable[str], out: Path) -> bool:
    """Return whether files belong to a take and lie below `out`, even after links are followed."""
    own = {f"{REPORT}/{name}.jpg", *(f"{name}.{ending}" for ending in _ENDINGS)}
    root = os.path.realpath(out)
    return own.issuperset(files) and all(Path(os.path.realpath(out / file)).is_relative_to(root) for file in files)


def failed_record(take: TakePlan, reason: str) -> Record:
    """Return the record of a take that failed; the next run tries it again."""
    return Record(take.name, take.source, take.digest, BAD, (reason,), is_kept=False)


def unwritten_record(take: TakePlan, error: OSError) -> Record:
    """Return the record of a take whose files the system cannot write."""
    is_long = error.errno == errno.ENAMETOOLONG
    advice = 'give the take a shorter name (name = "...")' if is_long else "choose a folder you may write to"
    return failed_record(take, f"cannot be written ({error.strerror or error}); {advice}")


def remove_old(take: TakePlan, out: Path) -> None:
    """Remove the record and outputs of an earlier run with other inputs.

    Raises:
        OSError: The files cannot be removed, or the take's name is too long for new ones.
    """
    with suppress(FileNotFoundError):
        (out / _TEMPORARY.format(take.name)).lstat()
    record = stored_record(take.name, out)
    for file in record.outputs.values() if record else ():
        (out / file).unlink(missing_ok=True)
    record_path(out, take.name).unlink(missing_ok=True)
