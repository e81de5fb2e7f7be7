"""Refinement of the first performer during a capture, by its recording so far."""

from pathlib import Path

import bpy

from ...core.errors import PerfanimError
from ...core.markers.subject import load_subject
from ...core.system.files import exists
from ..jobs.job import Job, command
from ..settings import performer_refinement

# Seconds of motion after which it is refined: enough for an offer, and the whole minute that a refinement looks at.
REFINED_AT_S = (20.0, 60.0)


class LiveRefinement:
    """Refines in a process of its own, after solver and Blender.

    The captured body stays as it is: one that changed within a recording would change its motion there.

    Args:
        take: file that the capture is recorded into.
        database: motion of its kind.
        python: interpreter of the process, None for Blender's own.
    """

    def __init__(self, take: str, database: str, python: str | None) -> None:
        self._take, self._database, self._python = take, database, python
        self._result = Path(bpy.app.tempdir) / f"refined live{performer_refinement.ENDING}"
        self._waiting = list(REFINED_AT_S)
        self._job: Job | None = None

    def tick(self, seconds: float) -> bool:
        """Go on after so many seconds of motion; return whether there is a new offer.

        It never waits. Where nothing can be refined, nothing is offered, and the capture goes on.
        """
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
            performer_refinement.keep_refined(self._take, subject, changes)
            performer_refinement.offer_capture(self._take)
        return bool(changes)

    def close(self) -> None:
        """End the process; an offer stays."""
        if self._job is not None:
            self._job.close()
            self._job = None
        self._result.unlink(missing_ok=True)
