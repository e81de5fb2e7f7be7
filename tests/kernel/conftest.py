"""The library must be there: `make kernel-test` builds it. The same database as in the tests of the core."""

import pytest
from perfanim.core.kernel.library import KERNEL, use_kernel
from small_database import *  # noqa: F403


@pytest.fixture(autouse=True, scope="session")
def _loaded() -> None:
    assert KERNEL.library is not None, KERNEL.text
    assert use_kernel(True)
