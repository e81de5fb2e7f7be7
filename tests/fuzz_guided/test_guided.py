"""The coverage-guided fuzzer. It needs atheris, so an environment of its own: `make fuzz GUIDED=yes`."""

from dataclasses import replace

import pytest
from fuzzing.doors import all_doors
from fuzzing.guided import GUIDED, further, run_guided

SEED, INPUTS, SECONDS = 1, 300, 60


@pytest.fixture(scope="module")
def doors(tmp_path_factory):
    return {door.name: door for door in all_doors(tmp_path_factory.mktemp("doors"))}


@pytest.mark.parametrize("name", GUIDED)
def test_short_guided_run_finds_new_branches_and_no_fault(doors, tmp_path, name):
    guided = run_guided(doors[name], SECONDS, INPUTS, SEED, tmp_path)
    assert guided.faults == {}
    assert guided.inputs >= INPUTS
    assert guided.reached[1] >= guided.reached[0] > 0
    assert list(tmp_path.iterdir()) == []


def test_inputs_that_reach_new_branches_are_developed_further(doors, tmp_path):
    poor = replace(doors["BVH"], corpus=(b"HIERARCHY\nROOT a\n{\n",), guided=())
    guided = run_guided(poor, SECONDS, 3000, SEED, tmp_path)
    assert guided.reached[1] > guided.reached[0]
    assert guided.found


def test_tiny_input_that_goes_further_than_the_corpus_is_kept(doors):
    door = replace(doors["BVH"], corpus=(b"HIERARCHY\n",), guided=())
    joint = b"ROOT a\n{\nOFFSET 0 0 0\nCHANNELS 3 Zrotation Xrotation Yrotation\nEnd Site\n{\nOFFSET 0 1 0\n}\n}\n"
    whole = b"HIERARCHY\n" + joint + b"MOTION\nFrames: 1\nFrame Time: 0.1\n0 0 0\n"
    assert further(door, [b"HIERARCHY\n", b"HIERARCHY \n", whole]) == [whole]
    assert further(door, [doors["BVH"].corpus[0]]) == [], "it is not tiny"
