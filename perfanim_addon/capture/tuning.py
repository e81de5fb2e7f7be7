"""Tuned numbers for captures and jobs in Blender."""

from dataclasses import dataclass


@dataclass(frozen=True)
class CaptureTuning:
    """Times, limits and sizes; chosen by trial unless a comment says otherwise."""

    tick_s: float = 1 / 240  # half a tick is the mean delay of a pose; a tick without a pose takes 0.1 ms
    sidebar_s: float = 1.0  # time between redraws of the statistics, which also redraw the viewport
    stop_limit_s: float = 8.0  # time for the last frames after Stop, on an idle computer
    freeze_notice_s: float = 0.2  # time without images after which the panel says so
    rate_window_s: float = 1.0  # time over which the frame rate is counted
    slownesses: tuple[int, ...] = (3, 5, 10, 20, 50)  # reported factors: only a few, so that the text rarely changes
    judged_poses: int = 600  # poses at the end of a capture that are used for its verdict: ten seconds at 60 Hz
    refined_at_s: tuple[float, float] = (20.0, 60.0)  # lengths of motion after which the performer is refined
    poses_in_memory: int = 1000  # poses that are written to disk together
    beep_s: float = 0.12
    tick_hz: float = 660.0  # beep in each of the last seconds before a calibration pose
    hold_hz: float = 1320.0  # beep at which a pose begins, and for each view of the board
    done_hz: float = 880.0  # beep at which a pose ends
    heard_s: tuple[int, ...] = (3, 2, 1)  # seconds left before a pose that are announced by a beep
    held_s: float = 2.0  # duration of each calibration pose
    job_tick_s: float = 0.1  # time between two readings of a job's messages
    tested_poses: int = 60  # number of poses in the self-test
    sure: float = 0.5  # least confidence of a good pose in the self-test


TUNING = CaptureTuning()
