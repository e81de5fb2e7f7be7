"""Main program of a worker process: one request, one job, then the end.

Requests (JSON):

- {"job": "capture", ...}: a whole capture, images to poses; starts a process of its own for the cameras.
- {"job": "cameras", ...}: images to marker frames.
- {"job": "trackers", ...}: trackers of another program, by VMC, to marker frames.
- {"job": "record board", ...}: cameras calibrated from a board held before them.
- {"job": "record floor", ...}: floor from the board lying on it.
- {"job": "record floor markers", ...}: floor from markers lying on it.
- {"job": "record pose", ...}: take of the performer's calibration poses.
- {"job": "calibrate performer", ...}: the same, and the performer measured from them.
- {"job": "show cameras"}: a picture of each plugged-in camera.
- {"job": "check setup", ...}: faults of light, cameras and markers before a capture.
- {"job": "sketch", ...}: a body from keyframed controls; with "live", again after each edit.
- {"job": "command", "arguments": [...]}: a command of the command line, with its progress as STATUS messages and
  its summary as RESULT, so that long work never freezes Blender.
"""

import signal
import sys
import traceback
from importlib import import_module
from types import ModuleType

from ..errors import CaptureError, PerfanimError
from .channel import Channel, Stopped
from .requests import check_request

# job -> its module in `jobs`
JOBS = {
    "capture": "run_capture",
    "cameras": "camera_frames",
    "trackers": "tracker_frames",
    "command": "run_command",
    "record board": "record_board",
    "record floor": "record_floor",
    "record floor markers": "record_floor_markers",
    "record pose": "record_pose",
    "calibrate performer": "calibrate_performer",
    "show cameras": "show_cameras",
    "check setup": "check_setup",
    "sketch": "sketch_solutions",
}


def main(port: int, token: str, name: str) -> int:
    """Connect to Blender, do the job of this name, return the exit status."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # so that half-written files are removed
    channel = Channel(port, token)
    try:
        job = _job(name)  # its libraries load while the request is on its way
        request = channel.wait_request()
        check_request(name, request)
        job.run(request, channel)
    except Stopped:
        return 0
    except PerfanimError as error:
        channel.send_error(error)
        return 1
    except ImportError as error:
        traceback.print_exc()
        advice = "install the archive made for this Blender's Python and platform"
        channel.send_error(CaptureError(f"cannot load a library: {error}", where="worker", advice=advice))
        return 1
    except Exception as error:
        # last resort of a process without a terminal: the traceback goes to its log, the user gets one line
        traceback.print_exc()
        channel.send_error(CaptureError(f"failed unexpectedly: {type(error).__name__}: {error}", where="worker"))
        return 1
    finally:
        channel.close()
    return 0


def _job(name: str) -> ModuleType:
    """Import and return the module of a job; the others' libraries are slow to load."""
    if name not in JOBS:
        raise CaptureError(f"does not know the job {name!r}", where="worker", advice="restart Blender")
    return import_module(f".jobs.{JOBS[name]}", __package__)
