"""Blocks of the sweep: which lengths are joined, and what waits."""

import pytest

from roller_emvs.methods.surface.blocks import BlockCutter
from roller_emvs.methods.surface.event_store import EventStore


def store_of(counts: dict[int, int], length_m: float) -> EventStore:
    """A store that says how many events each length holds."""

    class Store:
        blocks = tuple(counts)
        span = staticmethod(lambda k: (0.0, length_m, 0.0, 0.01))
        times = staticmethod(lambda k: (k, k + 1))
        count = staticmethod(lambda k: counts.get(k, 0))

    return Store()  # type: ignore[return-value]


def test_lengths_with_few_events_are_one_block_and_wait_for_each_other() -> None:
    counts, length = {0: 5, 1: 5, 2: 9000, 3: 10, 4: 10, 5: 10, 6: 10}, 0.008
    cutter = BlockCutter(store_of(counts, length), length, 2)

    def lengths(behind: float) -> list[tuple[int, int, int]]:
        found = cutter.ready(behind * length, 0.1)
        return [(block.number, block.end, block.events) for block in found]

    assert lengths(2.5) == [(-1, 2, 10)]
    # The next is full of events, and the one after waits for what it may be joined with.
    assert lengths(4.5) == [(2, 3, 9000)]
    assert lengths(4.5) == []
    assert lengths(5.5) == []
    assert lengths(6.5) == [(3, 6, 30)]
    found = cutter.ready(6.5 * length, 0.1, flush=True)
    assert [(block.number, block.end, block.events) for block in found] == [(6, 8, 10)]
    assert found[0].sources == (5, 6)
    assert (found[0].start_m, found[0].end_m) == (6 * length, 8 * length)
    assert (found[0].first_ns, found[0].last_ns) == (6, 7)


@pytest.mark.parametrize(
    ("speed", "counts", "begins"),
    [
        (0.2, [30_000, 90_000, 200_000, 900_000], [0, 1, 2, 3]),
        (0.5, [30_000, 90_000, 200_000, 300_000], [0, 3]),
        (0.5, [30_000, 90_000, 300_000, 300_000], [0, 3]),
        (0.5, [30_000, 400_000, 200_000, 300_000], [0, 2, 3]),
        # The end of what lies on the plate goes with it, but not a bare plate with what is on it.
        (0.5, [30_000, 90_000, 200_000, 3000], [0]),
        (0.5, [30_000, 900_000, 3000, 3000, 3000], [0, 4]),
        (0.5, [300, 100, 200, 3000], [0, 3]),
    ],
)
def test_a_fast_sensor_joins_lengths_with_more_events(
    speed: float, counts: list[int], begins: list[int]
) -> None:
    length = 0.008
    cutter = BlockCutter(store_of(dict(enumerate(counts)), length), length, 480)
    cutter._done = -1
    found = cutter.ready(4.5 * length, speed, flush=True)
    assert [block.number for block in found if block.events] == begins


def test_a_block_waits_for_a_length_with_few_events_so_far() -> None:
    counts, length = {0: 30_000, 1: 400_000, 2: 5000, 3: 9000}, 0.008
    cutter = BlockCutter(store_of(counts, length), length, 480)
    cutter._done = -1
    assert cutter.ready(2.5 * length, 0.5) == []
    counts[2] = 9000
    assert [(block.number, block.end) for block in cutter.ready(3.5 * length, 0.5)] == [(0, 2)]
