import pytest
from perfanim.core.system.slowness import Slowness


def test_work_that_has_a_processor_to_itself_is_not_slow() -> None:
    slowness = Slowness()
    assert slowness.factor == 1.0
    for _ in range(60):
        slowness.add(0.004, 0.004)
    assert slowness.factor == pytest.approx(1.0)


def test_slowness_is_how_many_times_longer_work_takes_and_is_forgotten_in_seconds() -> None:
    slowness = Slowness()
    for _ in range(20):
        slowness.add(0.020, 0.004)
    assert slowness.factor == pytest.approx(5.0)
    for _ in range(300):  # five seconds at 60 Hz
        slowness.add(0.004, 0.004)
    assert slowness.factor == pytest.approx(1.0, abs=0.3)


def test_one_late_moment_says_little_and_a_coarse_clock_not_too_much() -> None:
    slowness = Slowness()
    slowness.add(0.040, 0.001)
    assert slowness.factor == 1.0
    slowness = Slowness()
    slowness.add(0.080, 0.0)
    assert slowness.factor == 50.0


def test_a_process_beside_counts_as_well() -> None:
    slowness = Slowness()
    slowness.beside = 3.0
    assert slowness.factor == 3.0
    slowness.beside = 0.5
    assert slowness.factor == 1.0
