"""Damaged inputs at every reader of foreign input. PERFANIM_FUZZ_INPUTS: inputs of each (`make fuzz`)."""

import gc
import os
import signal
import sys
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import pytest
from fuzzing import limits
from fuzzing.containers import damaged_take
from fuzzing.damage import LARGEST, damaged_text
from fuzzing.doors import Door, all_doors
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from perfanim.core.errors import FormatError, TakeError
from perfanim.core.formats.take_file.footer import find_footer
from perfanim.core.formats.take_file.take_reader import read_take_file

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="looks at /proc")
INPUTS = int(os.environ.get("PERFANIM_FUZZ_INPUTS", "0"))
USUAL_INPUTS = 30
HUNG_S = 60
NAMES = (
    *("BVH", "ASF", "AMC", "archive", "tar archive", "board points"),
    *("TRC", "CSV", "array of keypoints", "Qualisys TSV", "C3D", "marker take", "recorded take", "database"),
    *("calibration", "stereo calibration in JSON", "stereo calibration in YAML", "subject"),
    *("marker set", "prop", "bone map", "sketch", "names", "plan"),
    *("pictures", "videos", "VMC packets", "worker messages", "marker frames", "poses", "worker requests"),
    *("image sources", "command line"),
)


@pytest.fixture(scope="module")
def doors(tmp_path_factory):
    doors = {door.name: door for door in all_doors(tmp_path_factory.mktemp("doors"))}
    assert tuple(doors) == NAMES
    with limits.limited_memory():
        yield doors


@pytest.fixture(autouse=True)
def not_for_ever():
    """A reader that hangs is stopped by a signal, which is a fault like any other exception."""
    yield
    signal.alarm(0)


def examples(count: int, repeat: bool = not INPUTS) -> settings:
    return settings(
        max_examples=count,
        derandomize=repeat,
        database=None,
        deadline=None,
        suppress_health_check=list(HealthCheck),
        phases=(Phase.generate, Phase.shrink),
    )


def throw(door: Door, data: bytes) -> limits.Outcome:
    signal.alarm(HUNG_S)
    outcome = limits.outcome_of(door, data)
    assert outcome.fault == "", f"{door.name}: {outcome.fault}"
    return outcome


@pytest.mark.parametrize("name", NAMES)
def test_corpus_is_read_or_refused(doors, name):
    outcomes = [throw(doors[name], data) for data in (*doors[name].corpus, *doors[name].guided)]
    if name != "tar archive":  # its first motion is that of a leg alone
        assert any(outcome.accepted for outcome in outcomes)


@pytest.mark.parametrize("name", NAMES)
def test_damaged_inputs_are_read_or_refused(doors, name):
    door = doors[name]
    count = max(round(door.share * (INPUTS or USUAL_INPUTS)), 5)
    accepted = []

    @examples(count)
    @given(st.sampled_from(door.corpus).flatmap(door.damage))
    def damaged(data: bytes) -> None:
        accepted.append(throw(door, data).accepted)

    damaged()
    if name != "VMC packets":  # a stream counts what it refuses
        assert not all(accepted)


def test_every_file_that_did_harm_is_in_the_corpus(doors):
    found = {path.read_bytes() for name in ("found", "guided") for path in (Path(__file__).parent / name).iterdir()}
    assert found
    assert found <= {data for door in doors.values() for data in (*door.corpus, *door.guided)}


class TwoLineError(FormatError):
    """An error that breaks the rules of its base."""

    def __str__(self) -> str:
        return "in\ntwo lines"


def busy(seconds: float) -> None:
    begun_s = time.process_time()
    while time.process_time() - begun_s < seconds:
        pass


def fails(error: BaseException) -> None:
    raise error


@pytest.mark.parametrize(
    ("read", "fault"),
    [
        (lambda data: fails(FormatError("is damaged")), ""),
        (lambda data: fails(KeyError("b")), "KeyError in the test"),
        (lambda data: fails(TwoLineError("")), "a message too long, or of several lines"),
        (lambda data: busy(0.3), "more than 0.2 s"),
        (lambda data: fails(MemoryError()), "MemoryError in the test"),
        (lambda data: bytes(range(256)) * (1 << 20), "more memory than 4 times the input and 64 MB"),
        (lambda data: None, ""),
    ],
)
def test_each_kind_of_fault_is_noticed(read, fault):
    door = Door("a door", (b"a",), damaged_text, read, longest_s=0.2)
    if "memory" in fault:
        door = replace(door, longest_s=60.0)
    assert limits.outcome_of(door, b"a").fault == fault


def test_garbage_that_is_collected_while_a_door_reads_hides_none_of_its_memory():
    def read(data: bytes) -> bytes:
        gc.collect()
        return bytes(range(256)) * (1 << 20)

    left = [bytes(range(256)) * (1 << 20)]
    left.append(left)
    del left
    assert "memory" in limits.outcome_of(Door("a door", (b"a",), damaged_text, read, longest_s=60.0), b"a").fault


def test_damage_reaches_large_inputs_and_shrinks():
    sizes = []

    @examples(150, repeat=True)
    @given(damaged_text(b"a = 1\nb\tc\td\n"))
    def measure(data: bytes) -> None:
        sizes.append(len(data))

    measure()
    assert LARGEST // 2 < max(sizes) <= LARGEST
    assert min(sizes) < 10


def test_damage_of_takes_reaches_facts_and_keeps_the_place_of_the_end_mark(doors, tmp_path):
    refused = with_end = 0

    @examples(250, repeat=True)
    @given(damaged_take(doors["recorded take"].corpus[0]))
    def read(data: bytes) -> None:
        nonlocal refused, with_end
        path = tmp_path / "damaged.perftake"
        path.write_bytes(data)
        with path.open("rb") as file, suppress(TakeError):
            with_end += find_footer(file) is not None
        with suppress(TakeError):
            refused += any(" must be " in str(fault) for fault in read_take_file(path).faults)

    read()
    assert refused >= 3
    assert with_end > 50
