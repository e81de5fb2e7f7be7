"""Job: solve sketches, once or after each edit in Blender.

Each RESULT is a `solution_table`. A live edit is answered with the current frame first, then with the whole motion; a
newer edit interrupts the work on an older one.
"""

from ...database.store import open_database
from ...errors import PerfanimError
from ...sketch.sketch_messages import motion_table, settings_from, sketch_from, solution_table
from ...sketch.solve_sketch import SketchSolver
from ..channel import Channel, Stopped
from ..requests import SketchEdit, SketchRequest, read_request


class _OutdatedError(Exception):
    """A newer edit is waiting, so this solution is outdated."""


def run(request: SketchRequest, channel: Channel) -> None:
    """Solve the request's sketch; if live, continue until Blender closes the connection.

    Raises:
        PerfanimError: The database is unusable, a request is damaged, or, if not live, the sketch cannot be solved.
    """
    channel.send_status("opening the database", 0.0)
    solver = SketchSolver(request.skeleton, open_database(request.database))
    if not request.live:
        _solve(solver, request, channel, is_live=False)
        return
    edit: SketchEdit = request
    while True:
        try:
            _solve(solver, edit, channel, is_live=True)
        except PerfanimError as error:  # the next edit may fix it
            channel.send_result({"number": edit.number, "error": str(error)})
        except _OutdatedError:
            pass
        table = channel.newest_request()
        if not table:
            return
        edit = read_request(SketchEdit.job, table)


def _solve(solver: SketchSolver, edit: SketchEdit, channel: Channel, is_live: bool) -> None:
    """Solve a sketch and send its solution; if live, send the current frame first and no progress."""
    sketch, settings = sketch_from(edit.sketch), settings_from(edit.settings)
    if is_live:
        motion = solver.preview(sketch, settings, edit.frame)
        if motion is not None:
            channel.send_result(motion_table(motion, edit.number))

    def progress(fraction: float, text: str) -> None:
        if channel.stop_requested.is_set():
            raise Stopped
        if not is_live:
            channel.send_status(text, fraction)
        elif channel.has_request:
            raise _OutdatedError

    channel.send_result(solution_table(solver.solve(sketch, settings, progress), edit.number))
