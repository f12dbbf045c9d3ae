"""Events that wait, against a plain list."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roller_core.event_queue import EventQueue
from roller_core.events import EventArray


def events_at(times: list[int]) -> EventArray:
    n = np.arange(len(times))
    return EventArray.from_arrays(n % 7, n % 5, times, n % 2)


@given(
    st.lists(st.lists(st.integers(0, 5), max_size=6), max_size=8),
    st.lists(st.tuples(st.sampled_from(["take", "drop", "count", "first"]), st.integers(0, 60))),
)
def test_it_is_a_list_of_events(steps: list[list[int]], asked: list[tuple[str, int]]) -> None:
    queue, plain, now = EventQueue(10**6), [], 0
    for gaps in steps:
        times = [now := now + gap for gap in gaps]
        queue.add(events_at(times))
        plain += times
        assert queue.newest_ns == (plain[-1] if plain else -(2**62))
    for what, value in asked:
        before = sum(t < value for t in plain)
        if what == "take":
            assert queue.take(value).t_ns.tolist() == plain[:value]
            plain = plain[value:]
        elif what == "drop":
            assert queue.drop_before(value) == before
            plain = plain[before:]
        elif what == "count":
            assert queue.count_before(value) == before
        else:
            assert queue.first(value).t_ns.tolist() == plain[:value]
        assert len(queue) == len(plain)
        assert [queue.time_of(n) for n in range(len(plain))] == plain
        if plain:
            assert queue.first_ns == plain[0]


@pytest.mark.parametrize("begin", [0, -5, 1_795_945_018_963_716_229, 2**32 - 2])
@pytest.mark.parametrize("last", [10, 2**32 - 1, 2**32, 2**40])
def test_times_come_out_as_they_came(begin: int, last: int) -> None:
    times = [begin, begin, begin + 3, begin + last - 1, begin + last]
    queue = EventQueue(100)
    queue.add(events_at(times))
    queue.add(events_at([times[-1] + 1]))
    assert queue.first(6).t_ns.tolist() == [*times, times[-1] + 1]
    assert queue.first(4).t_ns.tolist() == times[:4]
    for t_ns in (begin - 2**40, begin, begin + 1, begin + 4, begin + last, begin + last + 2):
        assert queue.count_before(t_ns) == sum(t < t_ns for t in [*times, times[-1] + 1])
    queue.drop(2)
    assert (queue.first_ns, queue.time_of(2)) == (begin + 3, begin + last)


def test_beyond_the_limit_the_oldest_go() -> None:
    queue = EventQueue(5)
    for start in (0, 10, 20):
        queue.add(events_at([start, start + 1, start + 2]))
    assert (len(queue), queue.dropped, queue.first_ns) == (3, 6, 20)
    # What came last stays, however much it is.
    queue.add(events_at(list(range(30, 50))))
    assert (len(queue), queue.dropped) == (20, 9)


def test_an_empty_queue_has_no_first() -> None:
    with pytest.raises(IndexError):
        _ = EventQueue(5).first_ns
    with pytest.raises(IndexError):
        EventQueue(5).time_of(0)
