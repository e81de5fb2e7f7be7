"""The networks that find a person without markers, for the jobs that watch cameras."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path

from ...errors import CaptureError
from ...vision.people.body_network import BlazePose
from ...vision.people.people_pipeline import PeoplePipeline
from ..requests import CamerasRequest
from ..worker_settings import WORKER


@contextmanager
def open_networks(request: CamerasRequest) -> Iterator[PeoplePipeline]:
    """Yield a pipeline with a network and a thread for each camera.

    Raises:
        CaptureError: The network is missing or damaged, or the cameras are not calibrated.
    """
    if request.rig is None:
        raise CaptureError("the cameras are not calibrated", advice="calibrate them first")
    networks = [BlazePose(Path(request.people)) for _ in request.rig.cameras]
    with ThreadPoolExecutor(len(networks)) as others:
        yield PeoplePipeline(request.rig, networks, WORKER.person_tries, others)
