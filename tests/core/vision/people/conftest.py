"""Fixtures for tests of people without markers."""

import pytest
from perfanim.core.geometry.rig_file import load_rig
from perfanim.core.vision.people.body_network import BlazePose
from perfanim.core.vision.people.network_file import body_network_file
from perfanim.core.vision.people.people_pipeline import PeoplePipeline
from perfanim.core.vision.sources.source_kinds import open_image_source


@pytest.fixture(scope="session")
def beam(shared_dir):
    """The calibrated cameras round a man on a beam, and what the network finds in each of their pictures."""
    if not body_network_file().is_file():
        pytest.skip("the body network is not here: perfanim network get")
    films = shared_dir / "people" / "walk-on-beam"
    rig, network = load_rig(films / "Calib.qca.txt"), BlazePose(body_network_file())
    pipeline = PeoplePipeline(rig, [network] * len(rig))
    return rig, [pipeline.detect(each) for each in open_image_source(*sorted(map(str, films.glob("cam0*.mp4"))))]
