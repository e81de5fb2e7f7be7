"""Self-test: the worker's libraries, the cameras, and a simulated capture."""

from typing import Any

from ...core.body.standard_skeleton import default_skeleton
from ...core.errors import CaptureError
from ...core.markers.marker_set import load_marker_set
from ...core.markers.subject import Subject
from ...core.simulate.studio.simulated_performer import SimulatedPerformer
from ...core.worker.client import WorkerClient
from ...core.worker.requests import CamerasRequest, CaptureRequest
from ..jobs.job import Job, command
from .capture_run import CaptureRun, Phase
from .tuning import TUNING

PANEL = "diagnostics"  # section of the preferences that shows the result
_MARKER_SET = "boxing"


class SelfTest(Job):
    """One run of the self-test; `lines` holds the results so far."""

    def __init__(self, database: str, first: Job | None, python: str | None) -> None:
        super().__init__("Self-test", PANEL, command(["diagnose"]), python, first=first)
        self.text = "looking for cameras"
        self.lines: list[str] = []
        self._database = database
        self._run: CaptureRun | None = None

    @property
    def ended(self) -> bool:
        """Whether the test is complete."""
        return self._run is not None and self._run.phase is Phase.DONE

    def tick(self) -> None:
        """Continue without waiting; PerfanimError if a step fails."""
        if self._run is not None:
            self._capture(self._run)
            return
        super().tick()
        if self.summary is not None:
            self.lines = _facts(self.summary)
            self._client.close()
            self._run = CaptureRun(WorkerClient(self._capture_request(), self._python))

    def _capture(self, run: CaptureRun) -> None:
        run.tick()
        self.text, self.fraction = run.activity, min(len(run.poses) / TUNING.tested_poses, 1.0)
        if len(run.poses) >= TUNING.tested_poses:
            run.stop()
        if run.error is not None:
            raise run.error
        if run.phase is Phase.DONE:
            good = sum(pose.performers[0].confidence >= TUNING.sure for pose in run.poses)
            self.lines.append(f"Capture of the simulated performer: {len(run.poses)} poses, {good} of them confident")
            if 2 * good < len(run.poses):
                raise CaptureError("the simulated performer is tracked poorly", advice="report this with these lines")

    def _capture_request(self) -> CaptureRequest:
        subject = Subject("Self-test", default_skeleton(), load_marker_set(_MARKER_SET))
        source = SimulatedPerformer(behaviour="walking", loop=True, marker_set=_MARKER_SET)
        cameras = CamerasRequest(source=source, background_s=1.0)
        return CaptureRequest(cameras=cameras, performers=(subject,), database=self._database)

    def close(self) -> None:
        """End the workers."""
        super().close()
        if self._run is not None:
            self._run.close()


def _facts(summary: dict[str, Any]) -> list[str]:
    libraries = ", ".join(f"{name} {fact}" for name, fact in summary["libraries"].items())
    cameras = [
        f"{camera['device']} ({'{}x{}'.format(*camera['size']) if camera['size'] else 'gives no image'})"
        for camera in summary["cameras"]
    ]
    return [
        f"Worker: Python {summary['python']}, {libraries}",
        f"Cameras found: {', '.join(cameras) or 'none, plug in two'}",
    ]
