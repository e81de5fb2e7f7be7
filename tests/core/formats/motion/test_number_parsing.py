"""Blocks of numbers are read as Python reads each of them."""

import numpy as np
import pytest
from perfanim.core.formats.motion.number_parsing import parse_numbers


def plain_text(count: int, separator: str = " ") -> str:
    random = np.random.default_rng(3)
    digits = random.integers(1, 9, (count, 2))
    values = random.uniform(-1.0, 1.0, count) * 10.0 ** digits[:, 0].clip(max=7)
    return separator.join(f"{value:.{decimals}f}" for value, decimals in zip(values, digits[:, 1], strict=True))


@pytest.mark.parametrize("separator", [" ", "\n", "\t", "  ", " \n"])
def test_numbers_of_many_lengths_are_read_to_the_last_bit(separator):
    text = plain_text(30_000, separator)
    assert parse_numbers(text.encode()).tolist() == [float(word) for word in text.split()]


@pytest.mark.parametrize(
    "word",
    [
        "7",
        "-0.0",
        "+1.5",
        ".5",
        "-.5",
        "5.",
        "1e5",
        "-1.65488e-014",
        "0.123456789",
        "123456789.25",
        "1.5e-3",
        "99999999.5",
    ],
)
def test_numbers_of_other_forms_are_read_among_plain_ones(word):
    read = parse_numbers(f"1.25 {word} -2.5 ".encode())
    assert read.tolist() == [1.25, float(word), -2.5]
    assert np.signbit(read[1]) == word.startswith("-")


@pytest.mark.parametrize(
    "word", [".", "-", "-.", "1..5", "1.2.3", "--1.5", "1.5a", "a1.5", "1,5", "1.5\x00", "1_0.5", "1:.5", "/1.5"]
)
def test_what_is_no_number_is_refused_among_plain_ones(word):
    assert parse_numbers(f"1.25 {word} -2.5".encode()) is None


def test_missing_numbers_are_nan():
    assert np.isnan(parse_numbers(b"1.5 nan 2.5")[1])
