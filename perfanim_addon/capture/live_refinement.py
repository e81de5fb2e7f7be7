"""Refinement of the first performer during a capture, from the take so far."""

from pathlib import Path

import bpy

from ...core.errors import PerfanimError
from ...core.markers.subject import load_subject
from ...core.system.files import exists
from ..jobs.job import Job, command
from ..settings import performer_refinement
from ..settings.performer_refinement import Refined, offer
from .tuning import TUNING


class LiveRefinement:
    """Refines the performer of a take in a low-priority process, and offers the result.

    The body of the running capture is not changed, because its motion would change within a recording.
    """

    def __init__(self, take: str, database: str, python: str | None) -> None:
        self._take, self._database, self._python = take, database, python
        self._result = Path(bpy.app.tempdir) / f"refined live{performer_refinement.ENDING}"
        self._waiting = list(TUNING.refined_at_s)
        self._job: Job | None = None

    def tick(self, seconds: float) -> bool:
        """Continue without waiting; return whether there is a new offer. An error ends only the refinement."""
        try:
            return self._advance(seconds)
        except PerfanimError:
            self.close()
            return False

    def _advance(self, seconds: float) -> bool:
        if self._job is None:
            if self._waiting and seconds >= self._waiting[0] and exists(self._take):
                self._waiting.pop(0)
                line = performer_refinement.command_line(self._take, self._database, self._result)
                self._job = Job("Refining the performer", "capture", command(line, gently=True), self._python)
            return False
        self._job.tick()
        if not self._job.ended:
            return False
        changes = self._job.summary["changes"] if self._job.summary else []
        subject = load_subject(self._result)
        self.close()
        if changes:
            offer.refined, offer.capture = Refined(self._take, subject, tuple(changes)), self._take
        return bool(changes)

    def close(self) -> None:
        """End the process; an offer remains."""
        if self._job is not None:
            self._job.close()
            self._job = None
        self._result.unlink(missing_ok=True)
