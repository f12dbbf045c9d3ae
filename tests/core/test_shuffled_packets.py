"""Packets that overtake one another are late, not lost, nor of two cameras."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roller_core.seq_gaps import SeqGaps


def seen(numbers: list[int]) -> SeqGaps:
    gaps = SeqGaps()
    for k, seq in enumerate(numbers):
        gaps.see("/events", seq, k)
    return gaps


@pytest.mark.parametrize("every", [2, 3, 7, 50])
def test_neighbours_that_change_places(every: int) -> None:
    numbers = list(range(100, 400))
    for k in range(0, len(numbers) - 1, every):
        numbers[k], numbers[k + 1] = numbers[k + 1], numbers[k]
    gaps = seen(numbers)
    assert (gaps.lost, gaps.gaps, gaps.restarts, gaps.places) == (0, 0, 0, [])
    assert gaps.late == len(range(0, len(numbers) - 1, every))


def test_what_is_still_missing_is_lost() -> None:
    gaps = seen([0, 1, 5, 3, 6, 7])
    assert (gaps.lost, gaps.gaps, gaps.late, gaps.restarts) == (2, 1, 1, 0)
    assert gaps.places[0].packets == 2
    # One that comes once more is no news.
    assert seen([0, 1, 2, 3, 10, 11, 12]).late == 0


@given(st.integers(0, 10**6), st.lists(st.integers(1, 8), max_size=30), st.integers(0, 99))
def test_any_order_within_a_gap(first: int, packets: list[int], seed: int) -> None:
    """After each leap what was missing comes, in any order."""
    rng, numbers, at = np.random.default_rng(seed), [first], first
    for count in packets:
        late = rng.permutation(np.arange(at + 1, at + 1 + count))
        numbers += [at + count + 1, *late.tolist()]
        at += count + 1
    gaps = seen(numbers)
    assert (gaps.lost, gaps.restarts) == (0, 0)
    assert gaps.late == sum(packets)
