"""The coverage-guided fuzzer. It needs atheris, so an environment of its own: `make fuzz-guided-test`."""

from dataclasses import replace

import pytest
from fuzz.doors import all_doors
from fuzz.guided import GUIDED, run_guided

SEED, INPUTS, SECONDS = 1, 300, 60


@pytest.fixture(scope="module")
def doors(tmp_path_factory):
    return {door.name: door for door in all_doors(tmp_path_factory.mktemp("doors"))}


@pytest.mark.parametrize("name", GUIDED)
def test_a_short_guided_run_finds_new_branches_and_no_fault(doors, tmp_path, name):
    guided = run_guided(doors[name], SECONDS, INPUTS, SEED, tmp_path)
    assert guided.row.faults == {}
    assert guided.row.inputs >= INPUTS
    assert guided.reached[1] >= guided.reached[0] > 0
    assert list(tmp_path.iterdir()) == []


def test_it_goes_on_from_inputs_that_reach_new_branches(doors, tmp_path):
    poor = replace(doors["BVH"], corpus=(b"HIERARCHY\nROOT a\n{\n",), guided=())
    guided = run_guided(poor, SECONDS, 3000, SEED, tmp_path)
    assert guided.reached[1] > guided.reached[0]
    assert guided.found
