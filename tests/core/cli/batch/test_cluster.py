"""The recipe for several machines: a Dask cluster, here on this one."""

from functools import partial

import pytest
from perfanim.core.cli.batch.cluster import on_cluster
from perfanim.core.cli.batch.take_server import serve_task
from perfanim.core.errors import SettingsError
from perfanim.tests.core.cli.batch.conftest import files, run


@pytest.mark.long
def test_a_cluster_gives_the_same_bytes(finished, inputs, tmp_path):
    distributed = pytest.importorskip("distributed")  # not above: it takes long to import
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        result = run(inputs.plan(), tmp_path / "out", partial(on_cluster, cluster.scheduler_address, serve_task))
    assert result.finished_before == set()
    assert files(tmp_path / "out") == files(finished[0])


def test_no_cluster_there(inputs, tmp_path):
    pytest.importorskip("distributed")
    with pytest.raises(SettingsError, match="no Dask scheduler answers"):
        run(inputs.plan("a.c3d"), tmp_path / "out", partial(on_cluster, "not an address", serve_task))
