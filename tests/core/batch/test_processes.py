"""Processes that do takes, and what happens when one dies."""

from functools import partial
from pathlib import Path

import pytest
from perfanim.core.batch.processes import in_processes
from perfanim.core.batch.record import BAD
from perfanim.core.cli import batch_worker

from .conftest import run

# answers every task but that of c.csv, on which it dies
MORTAL = """
import json, os, sys
sys.stdin.readline()
for line in sys.stdin:
    take = json.loads(line)["take"]
    if take["name"] == "c":
        os._exit(9)
    told = {"name": take["name"], "source": "", "digest": take["digest"], "status": "good", "reasons": [],
            "warnings": [], "figures": {"pid": os.getpid()}, "outputs": {}, "sha256": {}, "is_kept": True}
    print(json.dumps(told), flush=True)
"""


@pytest.mark.parametrize("jobs", [1, 2])
def test_a_process_that_dies_costs_its_take_alone(inputs, tmp_path, jobs):
    script = tmp_path / "mortal.py"
    script.write_text(MORTAL)
    takes = inputs.plan("a.c3d", "b.trc", "c.csv", "d.take.npz")
    result = run(takes, tmp_path / "out", partial(in_processes, script, jobs))
    assert {r.name: r.status for r in result.records} == {"a": "good", "b": "good", "c": BAD, "d": "good"}
    (dead,) = [record for record in result.records if record.status == BAD]
    assert "ended without a word" in dead.reasons[0]
    assert not dead.is_kept
    answered = {record.figures["pid"] for record in result.records if record.name != "c"}
    assert len(answered) <= jobs + 1


def test_what_a_library_prints_comes_not_between_the_answers(inputs, tmp_path):
    script, served = tmp_path / "loud.py", Path(batch_worker.__file__).read_text()
    loud = served.replace("    while True:\n", '    while True:\n        os.write(1, b"a line of a library\\n")\n')
    assert loud != served
    script.write_text(loud)
    (record,) = run(inputs.plan("empty.c3d"), tmp_path / "out", partial(in_processes, script, 1)).records
    assert record.reasons == ("is empty",)
