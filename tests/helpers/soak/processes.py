"""Requests of captures, and the processes that they start."""

from pathlib import Path
from typing import Any, TypeAlias

from perfanim.core.body.standard_skeleton import default_skeleton
from perfanim.core.database.build_database import BuildSettings, build_database
from perfanim.core.markers.marker_set import load_marker_set
from perfanim.core.markers.subject import Subject, subject_tables
from perfanim.core.system.assets import MOTION

HELPERS = Path(__file__).resolve().parents[1]
Row: TypeAlias = dict[str, Any]  # figures of one trial; "wrong" is empty where all held

_WALKING = {"kind": "simulated", "behaviour": "walking", "seconds": 60.0, "height_m": 1.75, "loop": True}


def simulated_request(folder: Path, source: Row = _WALKING, clips: list[str] | None = None) -> Row:
    """Return the request of a capture, with a database of its own in the folder."""
    build_database(clips or [str(MOTION)], folder / "starter.pfdb", BuildSettings(fps=60.0))
    return {
        "job": "capture",
        "cameras": {"source": source, "rig": None, "threshold": None},
        "performers": [subject_tables(Subject("Sim", default_skeleton(1.75), load_marker_set("boxing")))],
        "database": str(folder / "starter.pfdb"),
        "take": str(folder / "take.perftake"),
    }


def children(process_id: int) -> list[int]:
    """Return the processes that a process has started and that live."""
    found = []
    for status in Path("/proc").glob("[0-9]*/status"):
        try:
            if f"PPid:\t{process_id}\n" in status.read_text():
                found.append(int(status.parent.name))
        except OSError:
            continue
    return found


def is_running(process_id: int) -> bool:
    """Return whether a process runs; one that has ended and is not waited for does not."""
    try:
        state = Path(f"/proc/{process_id}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"


def descendants(process_id: int) -> list[int]:
    """Return the processes that a process and its children have started."""
    return [found for child in children(process_id) for found in (child, *descendants(child))]


def family(process_id: int) -> list[int]:
    """Return a process and those that it has started."""
    return [process_id, *children(process_id)]


def memory_mb(process: int | str) -> float:
    """Return the memory in use (RSS) of a process that may have ended."""
    try:
        return int(Path(f"/proc/{process}/statm").read_text().split()[1]) * 4096 / 1e6
    except (OSError, IndexError):
        return 0.0
