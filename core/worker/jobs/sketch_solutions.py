"""Solve sketches: one, or again after each edit in Blender.

Request: "skeleton" (rows of `skeleton_table`), "database", "live", and what each further request has, too: "number",
"sketch", "settings", live also "frame". Each RESULT is a `solution_table`. Live, an edit gets a first picture, of that
frame only, and then the whole; a newer edit ends the work on an older one.
"""

from collections.abc import Mapping
from typing import Any

from ...database.store import open_database
from ...errors import PerfanimError, SkeletonError
from ...markers.subject import skeleton_from
from ...sketch.sketch_messages import motion_table, settings_from, sketch_from, solution_table
from ...sketch.solve_sketch import SketchSolver
from ...system.files import reading
from ..channel import Channel, Stopped
from ..requests import check_request


class _OutdatedError(Exception):
    """A newer edit waits: nobody needs this solution any more."""


def run(request: Mapping[str, Any], channel: Channel) -> None:
    """Solve the request's sketch; live, go on until Blender closes the connection.

    Raises:
        PerfanimError: the database is unusable, or a request damaged; not live, the sketch cannot be solved.
    """
    channel.send_status("opening the database", 0.0)
    with reading("sketch", SkeletonError, "choose the character again"):
        skeleton = skeleton_from(request["skeleton"], "sketch")
    solver = SketchSolver(skeleton, open_database(request["database"]))
    if not request.get("live"):
        _solve(solver, request, channel, is_live=False)
        return
    while request:
        check_request("sketch edit", request)
        try:
            _solve(solver, request, channel, is_live=True)
        except PerfanimError as error:  # the next edit may mend it
            channel.send_result({"number": int(request["number"]), "error": str(error)})
        except _OutdatedError:
            pass
        request = channel.newest_request()


def _solve(solver: SketchSolver, request: Mapping[str, Any], channel: Channel, is_live: bool) -> None:
    """Solve a sketch and send its solution; live a first picture, and no progress."""
    number = int(request.get("number", 0))
    sketch, settings = sketch_from(request["sketch"]), settings_from(request["settings"])
    if is_live:
        motion = solver.preview(sketch, settings, float(request["frame"]))
        if motion is not None:
            channel.send_result(motion_table(motion, number))

    def progress(fraction: float, text: str) -> None:
        if channel.stop_requested.is_set():
            raise Stopped
        if not is_live:
            channel.send_status(text, fraction)
        elif channel.has_request:
            raise _OutdatedError

    channel.send_result(solution_table(solver.solve(sketch, settings, progress), number))
