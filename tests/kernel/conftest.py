"""The library must be there: `make extras-test` builds it. The same database as in the tests of the core."""

import pytest
from hypothesis import HealthCheck, settings
from perfanim.core.kernel.library import KERNEL, use_kernel
from small_database import *  # noqa: F403

settings.register_profile("kernel", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("kernel")


@pytest.fixture(autouse=True, scope="session")
def _loaded() -> None:
    assert KERNEL.library is not None, KERNEL.text
    assert use_kernel(True)
