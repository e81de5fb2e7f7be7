"""Records of a batch's takes, and tasks for its processes.

Nothing here solves or draws, so the process that hands out takes loads fast.
"""

import json
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from pathlib import Path

from .content_hash import file_digest
from .plan import TakePlan

REPORT = "report"  # folder of records and pictures below that of the results

GOOD, DOUBTFUL, BAD = "good", "doubtful", "bad"


@dataclass(frozen=True)
class Record:
    """Record of a take, kept beside its outputs.

    Args:
        status: GOOD, DOUBTFUL (check it) or BAD (no motion).
        figures: of `quality_figures`; empty when it could not be solved.
        outputs: kind -> file below the folder of the results.
        sha256: file -> digest of its bytes.
        is_kept: whether a later run takes it as done; False where another try may succeed.
    """

    name: str
    source: str
    digest: str
    status: str
    reasons: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    figures: dict[str, float | int | None] = field(default_factory=dict)
    outputs: dict[str, str] = field(default_factory=dict)
    sha256: dict[str, str] = field(default_factory=dict)
    is_kept: bool = True

    @classmethod
    def of_text(cls, text: str) -> "Record":
        """Return the record of a JSON object; ValueError or TypeError when it is none."""
        table = json.loads(text)
        return cls(**{**table, "reasons": tuple(table["reasons"]), "warnings": tuple(table["warnings"])})

    def text(self) -> str:
        """Return the record as a JSON object on one line."""
        return json.dumps(asdict(self), sort_keys=True)


@dataclass(frozen=True)
class Task:
    """One take to be done, as it goes to another process.

    Args:
        work: folder below it for unfinished files.
    """

    take: TakePlan
    out: str
    work: str

    @classmethod
    def of_text(cls, text: str) -> "Task":
        """Return the task of a JSON object."""
        table = json.loads(text)
        return cls(TakePlan(**table["take"]), table["out"], table["work"])

    def text(self) -> str:
        """Return the task as a JSON object on one line."""
        return json.dumps(asdict(self))


def record_path(out: Path, name: str) -> Path:
    """Return where the record of a take is kept."""
    return out / REPORT / f"{name}.json"


def finished_record(take: TakePlan, out: Path) -> Record | None:
    """Return the record of an earlier run, if inputs and outputs are unchanged."""
    record = stored_record(take.name, out)
    if record is None or record.digest != take.digest:
        return None
    if any(file_digest(out / file) != digest for file, digest in record.sha256.items()):
        return None
    return record


def stored_record(name: str, out: Path) -> Record | None:
    """Return an earlier run's record of a take, None if none can be read."""
    try:
        return Record.of_text(record_path(out, name).read_text(encoding="utf-8"))
    except (OSError, ValueError, TypeError, KeyError):
        return None


def failed_record(take: TakePlan, reason: str) -> Record:
    """Return the record of a take that failed; the next run tries it again."""
    return Record(take.name, take.source, take.digest, BAD, (reason,), is_kept=False)


def remove_old(take: TakePlan, out: Path) -> None:
    """Remove the record and the outputs of an earlier run with other inputs."""
    record = stored_record(take.name, out)
    for file in record.outputs.values() if record else ():
        if Path(file).name.startswith(take.name):
            (out / file).unlink(missing_ok=True)
    with suppress(FileNotFoundError):
        record_path(out, take.name).unlink()
