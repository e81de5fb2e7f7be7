"""What the performer reads while a capture or a calibration runs."""

from ...core.body.calibration_poses import INSTRUCTIONS
from ...core.session.gestures import Gesture
from ...core.worker.job_status import PoseStage
from ..jobs import activity
from ..jobs.job import Job
from ..viewport.performer_screen import GREEN, RED, PerformerView
from .live_capture import LiveCapture


def performer_view(gesture: Gesture | None) -> PerformerView:
    """Return what the performer reads now.

    Args:
        gesture: Signal that starts and stops the recording; None for none.
    """
    running = activity.current()
    if isinstance(running, LiveCapture):
        return _of_capture(running, gesture)
    if isinstance(running, Job):
        return _of_job(running)
    return PerformerView("Ready", activity.message("capture")[0] or "Start Capture, or Ctrl Shift R, begins.")


def _of_capture(capture: LiveCapture, gesture: Gesture | None) -> PerformerView:
    run, recording = capture.run, capture.recording
    if run is None or not run.poses:
        return PerformerView("Wait", capture.line)
    newest = run.poses[-1]
    problem = "; ".join(note.text for note in newest.notes if not note.is_decision)
    signal = f"{gesture.value.capitalize()} to " if gesture is not None else ""
    if recording is None:
        return PerformerView("Not recording", f"{signal}start." if signal else "", problem, GREEN)
    if recording.seconds_left:
        return PerformerView(str(recording.seconds_left), "Get ready.", problem)
    seconds = int(recording.seconds(run.poses))
    return PerformerView(f"REC {seconds // 60}:{seconds % 60:02d}", f"{signal}stop." if signal else "", problem, RED)


def _of_job(job: Job) -> PerformerView:
    cue = job.cue
    if cue is None:
        return PerformerView(job.title, job.text)
    pose, words = next(((name, text) for name, text in INSTRUCTIONS.items() if text in job.text), ("", job.text))
    line = f"{words[:1].upper()}{words[1:]}."
    if cue.stage is PoseStage.HOLD:
        return PerformerView("Hold still", line, colour=GREEN, pose=pose)
    return PerformerView(str(cue.left_s), line, pose=pose)
