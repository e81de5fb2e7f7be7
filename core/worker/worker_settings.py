"""Timeouts and limits of the worker's processes."""

from dataclasses import dataclass


@dataclass(frozen=True)
class WorkerSettings:
    """Timeouts and limits of the worker's processes and jobs."""

    # processes and their connection
    heartbeat_s: float = 0.5  # interval between two signs of life
    retry_s: float = 0.1  # pause before something that was not ready is tried again
    idle_s: float = 0.02  # pause of a loop that has nothing to do
    grace_s: float = 3.0  # time for a job to end by itself after Blender has gone
    freed_s: float = 5.0  # time for a replaced process to release cameras or port
    blocked_s: float = 20.0  # time without executing any Python after which a library call has hung
    greeting_s: float = 1.0  # time for a connected program to send its token
    dying_s: float = 1.0  # time for a process to end once its standard input is closed
    start_s: float = 60.0  # time for a process to connect
    silence_s: float = 15.0  # longest silence of a working process before its first frame
    hung_s: float = 1.25  # the same after the first frame, on an idle machine
    # largest part of the time between two polls that counts as silence, because the poller itself may be held up
    poll_gap_s: float = 0.25
    restarts: int = 3  # restarts of a process that are allowed within `restarts_within_s`
    restarts_within_s: float = 60.0
    stop_s: float = 5.0  # time for the cameras to stop
    orphan_stop_s: float = 1.0  # the same after Blender has gone
    report_s: float = 0.5  # interval between two reports of the skew between cameras
    ack_s: float = 0.25  # longest wait for Blender to take a pose
    poll_bytes: int = 8 << 20  # approximate number of bytes received by one poll; the rest waits for the next
    poll_messages: int = 1000  # messages received by one poll
    period_s: float = 1.0 / 60.0  # assumed period of a source that has shown only one frame
    gap_s: float = 0.05  # shortest gap in a capture that is reported

    # jobs
    empty_images: int = 30  # images of the simulated capture space from which the background is learned
    spread_images: int = 40  # the same for a recording that always shows the performer: spread over its length
    frames_ahead: int = 2  # frames that wait for the solver, from sources that can wait
    person_tries: int = 4  # crops in which a person is searched in each picture; more would delay the frames
    compared_s: float = 0.06  # time between the pictures of a video that synchronise it with others
    preview_px: int = 320  # width of one camera's picture
    preview_s: float = 0.2  # interval between two previews
    taken_s: float = 0.6  # time for which a preview shows that a view of the board was taken
    board_places: int = 40  # number of positions of the simulated board
    recording_s: float = 60.0  # longest recording that is searched for calibration poses
    trackers_s: float = 0.1  # longest wait for a packet from trackers
    silent_trackers_s: float = 1.0  # time without a marker after which the user is told why
    flood_s: float = 1.0  # time after the last excess packet at which a flood ends
    flood_frames: int = 60  # frames of a flood that may wait for the solver; further ones are dropped


WORKER = WorkerSettings()
