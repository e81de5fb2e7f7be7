"""Waits and limits of the worker's processes."""

from dataclasses import dataclass


@dataclass(frozen=True)
class WorkerSettings:
    """Waits and limits of the worker's processes and jobs."""

    # processes and their connection
    heartbeat_s: float = 0.5  # between two signs of life
    retry_s: float = 0.1  # between two attempts
    idle_s: float = 0.02  # wait of a loop without work
    grace_s: float = 3.0  # for a job to end by itself once Blender is gone
    freed_s: float = 5.0  # in which a replaced process releases cameras or port
    blocked_s: float = 20.0  # without any Python executed: then a library never returns
    greeting_s: float = 1.0  # for a program that connects to send its token
    dying_s: float = 1.0  # from a closed standard input to the end of a process
    start_s: float = 60.0  # for a process to connect
    silence_s: float = 15.0  # without a message, before the first frame
    hung_s: float = 1.25  # without a sign of life after it, on an idle machine
    poll_gap_s: float = 0.25  # longest time between two polls that counts as silence: the poller may be held up
    restarts: int = 3  # restarts of a process that are allowed within `restarts_within_s`
    restarts_within_s: float = 60.0
    stop_s: float = 5.0  # for the cameras to stop
    orphan_stop_s: float = 1.0  # the same once Blender is gone
    report_s: float = 0.5  # between two reports of the cameras' skew
    ack_s: float = 0.25  # wait for Blender to take a pose
    poll_bytes: int = 8 << 20  # received by one poll, about; the rest waits for the next
    poll_messages: int = 1000  # the same
    period_s: float = 1.0 / 60.0  # period of a source that has shown one frame only
    gap_s: float = 0.05  # shorter gaps of a capture are not reported

    # jobs
    empty_images: int = 30  # images of the simulated room to learn the background from
    spread_images: int = 40  # images from all over a recording that shows the performer, for the same
    frames_ahead: int = 2  # frames that wait for the solver, from sources that can wait
    preview_px: int = 320  # width of one camera's picture
    preview_s: float = 0.2  # between two previews
    taken_s: float = 0.6  # time for which a preview says that a view of the board was taken
    board_places: int = 40  # places of the simulated board
    recording_s: float = 60.0  # longest recording that is searched for calibration poses
    trackers_s: float = 0.1  # wait for a packet of trackers
    silent_trackers_s: float = 1.0  # without a marker until the reason is sent
    flood_s: float = 1.0  # time after the last packet too many for which a flood lasts
    flood_frames: int = 60  # frames of a flood that wait for the solver; further ones are left out


WORKER = WorkerSettings()
