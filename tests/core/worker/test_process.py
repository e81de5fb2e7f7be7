"""Every job that can be asked for has a module."""

import pytest
from perfanim.core.errors import CaptureError
from perfanim.core.worker import process


@pytest.mark.parametrize("name", process.JOBS)
def test_each_job_has_a_module_that_runs_it(name):
    assert callable(process._job(name).run)


def test_an_unknown_job_is_refused():
    with pytest.raises(CaptureError, match="does not know the job 'dance'"):
        process._job("dance")
