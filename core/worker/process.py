"""Main program of a worker process, which does one job."""

import signal
import sys
import traceback
from importlib import import_module
from types import ModuleType

from ..errors import CaptureError, PerfanimError
from .channel import Channel, Stopped
from .requests import read_request

# job -> its module in `jobs`; its request is in `requests`
JOBS = {
    "capture": "run_capture",
    "cameras": "camera_frames",
    "trackers": "tracker_frames",
    "command": "run_command",
    "record board": "record_board",
    "record walk": "record_walk",
    "record floor": "record_floor",
    "record floor markers": "record_floor_markers",
    "record pose": "record_pose",
    "calibrate performer": "calibrate_performer",
    "show cameras": "show_cameras",
    "check setup": "check_setup",
    "sketch": "sketch_solutions",
}


def main(port: int, token: str, name: str) -> int:
    """Connect to Blender, run a job, and return the exit status."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # so that half-written files are removed
    channel = Channel(port, token)
    try:
        job = _job(name)  # its libraries load while the request is on its way
        job.run(read_request(name, channel.wait_request()), channel)
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
        # this process has no terminal: the traceback goes to its log, and the user gets one line
        traceback.print_exc()
        channel.send_error(
            CaptureError(f"failed unexpectedly: {type(error).__name__}: {error}", where="worker", advice="report this")
        )
        return 1
    finally:
        channel.close()
    return 0


def _job(name: str) -> ModuleType:
    """Import and return the module of a job; other jobs' libraries would be slow to load."""
    if name not in JOBS:
        raise CaptureError(f"does not know the job {name!r}", where="worker", advice="restart Blender")
    return import_module(f".jobs.{JOBS[name]}", __package__)
