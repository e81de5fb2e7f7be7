"""Waits and limits of the worker's processes."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Timing:
    """Waits and limits of the worker's processes, seconds."""

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
    poll_gap_s: float = 0.25  # between two polls that counts as silence at most: the poller may have been held up
    restarts_within_s: float = 60.0  # in which a process may be replaced three times
    stop_s: float = 5.0  # for the cameras to stop
    orphan_stop_s: float = 1.0  # the same once Blender is gone
    report_s: float = 0.5  # between two reports of the cameras' skew
    ack_s: float = 0.25  # wait for Blender to take a pose


TIMES = Timing()
