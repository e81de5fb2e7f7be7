"""Solve sketches: one, or again after each edit in Blender.

Request: "skeleton" (rows of `skeleton_table`), "database", "live", and what each further request has, too: "number",
"sketch", "settings". Each RESULT is a `solution_table`. Live, an edit gets a first picture and then the whole; a newer
edit ends the work on an older one.
"""

from collections.abc import Mapping
from typing import Any

from ...database.store import open_database
from ...errors import PerfanimError
from ...markers.subject import skeleton_from
from ...sketch.solve_sketch import SketchSolver
from ..channel import Channel, Stopped
from ..sketch_messages import settings_from, sketch_from, solution_table


class _OutdatedError(Exception):
    """A newer edit waits: nobody needs this solution any more."""


def run(request: Mapping[str, Any], channel: Channel) -> None:
    """Solve the request's sketch; live, go on until Blender closes the connection.

    Raises:
        PerfanimError: the database is unusable; not live, the sketch cannot be solved.
    """
    channel.send_status("opening the database", 0.0)
    solver = SketchSolver(skeleton_from(request["skeleton"]), open_database(request["database"]))
    if not request.get("live"):
        _solve(solver, request, channel, lambda: False)
        return
    while request:
        try:
            _solve(solver, request, channel, lambda: channel.has_request, has_preview=True)
        except PerfanimError as error:  # the next edit may mend it
            channel.send_result({"number": int(request["number"]), "error": str(error)})
        except _OutdatedError:
            pass
        request = channel.newest_request()


def _solve(
    solver: SketchSolver, request: Mapping[str, Any], channel: Channel, outdated: Any, has_preview: bool = False
) -> None:
    """Solve a sketch and send its solution, on wish a first picture before."""
    number = int(request.get("number", 0))
    sketch, settings = sketch_from(request["sketch"]), settings_from(request["settings"])
    if has_preview:
        channel.send_result(solution_table(solver.preview(sketch, settings), number, whole=False))

    def progress(fraction: float, text: str) -> None:
        if channel.stop_requested.is_set():
            raise Stopped
        if outdated():
            raise _OutdatedError
        channel.send_status(text, fraction)

    channel.send_result(solution_table(solver.solve(sketch, settings, progress), number, whole=True))
