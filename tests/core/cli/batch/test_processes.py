"""Processes that do takes, and what happens when one dies."""

from collections.abc import Callable
from functools import partial

import pytest
from perfanim.core.cli.batch.processes import in_processes
from perfanim.core.cli.batch.take_record import BAD
from perfanim.tests.core.cli.batch.conftest import run

# answers every task but that of c.csv, on which it dies
MORTAL = """
import json, os, sys

def serve():
    for line in sys.stdin:
        take = json.loads(line)["take"]
        if take["name"] == "c":
            os._exit(9)
        told = {"name": take["name"], "source": "", "digest": take["digest"], "status": "good", "reasons": [],
                "warnings": [], "figures": {"pid": os.getpid()}, "outputs": {}, "sha256": {}, "is_kept": True}
        print(json.dumps(told), flush=True)
"""
# as if a library printed something with each take
LOUD = """
import os
from perfanim.core.cli.batch import take_server

serve_task = take_server.serve_task

def loud(text):
    os.write(1, b"a line of a library\\n")
    return serve_task(text)

def serve():
    take_server.serve_task = loud
    take_server.serve()
"""


@pytest.fixture
def served(tmp_path, monkeypatch) -> Callable[[str], str]:
    """Return how processes are told to serve tasks with the `serve` of a text."""
    monkeypatch.syspath_prepend(tmp_path)

    def serving(text: str) -> str:
        (tmp_path / "told_by_test.py").write_text(text)
        return "told_by_test:serve"

    return serving


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_process_that_dies_costs_its_take_alone(inputs, tmp_path, served, jobs):
    takes = inputs.plan("a.c3d", "b.trc", "c.csv", "d.take.npz")
    result = run(takes, tmp_path / "out", partial(in_processes, served(MORTAL), jobs))
    assert {r.name: r.status for r in result.records} == {"a": "good", "b": "good", "c": BAD, "d": "good"}
    (dead,) = [record for record in result.records if record.status == BAD]
    assert "ended without a message" in dead.reasons[0]
    assert not dead.is_kept
    answered = {record.figures["pid"] for record in result.records if record.name != "c"}
    assert len(answered) <= jobs + 1


def test_what_a_library_prints_comes_not_between_the_answers(inputs, tmp_path, served):
    (record,) = run(inputs.plan("empty.c3d"), tmp_path / "out", partial(in_processes, served(LOUD), 1)).records
    assert record.reasons == ("is empty; export it again",)
