"""Every job that can be asked for has a module."""

import pytest
from perfanim.core.worker import process


@pytest.mark.parametrize("name", process.JOBS)
def test_each_job_has_a_module_that_runs_it(name):
    assert callable(process._job(name).run)
