"""Events that come when a pixel wakes up, against those that show an edge."""

import numpy as np
import pytest

from roller_core.dead_time import DeadTime
from roller_core.events import EventArray

MS = 1_000_000
WIDTH, HEIGHT = 64, 48


def passing(dead_ns: int, seed: int = 3, edges: int = 20) -> tuple[EventArray, np.ndarray]:
    """Edges that pass all pixels 6 to 12 ms apart, each followed by an event from `dead_ns` on.

    With a few events of noise. Second: which show an edge.
    """
    rng = np.random.default_rng(seed)
    first = np.cumsum(rng.integers(6 * MS, 12 * MS, (edges, HEIGHT, WIDTH)), axis=0)
    late = first + dead_ns + rng.exponential(0.1 * MS, first.shape).astype(np.int64)
    y, x = np.broadcast_to(np.mgrid[:HEIGHT, :WIDTH][:, None], (2, *first.shape))
    noise = 50
    t = np.concatenate([first.ravel(), late.ravel(), rng.integers(0, first.max(), noise)])
    row = np.concatenate([y.ravel(), y.ravel(), rng.integers(0, HEIGHT, noise)])
    column = np.concatenate([x.ravel(), x.ravel(), rng.integers(0, WIDTH, noise)])
    kind = np.repeat([True, False, False], [first.size, first.size, noise])
    order = np.argsort(t, kind="stable")
    events = EventArray.from_arrays(column[order], row[order], t[order], kind[order])
    return events, kind[order]


@pytest.mark.parametrize(
    ("dead_us", "known_us"), [(1000, 1000), (800, 800), (100, 0), (300, 0), (2500, 0)]
)
def test_it_is_measured_where_it_matters_and_can_be_one(dead_us: int, known_us: int) -> None:
    dead = DeadTime(WIDTH, HEIGHT)
    events, _ = passing(dead_us * 1000)
    assert dead.measure(events) == (known_us > 0)
    assert dead.ns == known_us * 1000


def test_few_events_say_nothing() -> None:
    dead = DeadTime(WIDTH, HEIGHT)
    assert not dead.measure(passing(MS)[0][:2000])
    assert not dead.measure(EventArray.from_arrays([], [], [], []))


def test_a_pixel_that_fires_by_itself_has_little_say() -> None:
    events, _ = passing(MS)
    hot = np.arange(events.t_ns[0], events.t_ns[-1], 3 * MS // 4)
    t = np.concatenate([events.t_ns, hot])
    order = np.argsort(t, kind="stable")
    x, y = (np.append(v, np.full(len(hot), 16))[order] for v in (events.x, events.y))
    dead = DeadTime(WIDTH, HEIGHT)
    assert dead.measure(EventArray.from_arrays(x, y, t[order], np.zeros(len(t))))
    assert dead.ns == MS


def test_gaps_that_get_frequent_bit_by_bit_are_of_the_object() -> None:
    """As on a smooth dome, read out every 0.2 ms."""
    rng = np.random.default_rng(5)
    gaps = np.ceil(10 * np.sqrt(rng.random((20, WIDTH))) / 0.2).astype(np.int64) * (MS // 5)
    t, x = np.cumsum(gaps, axis=0).ravel(), np.tile(np.arange(WIDTH), 20)
    rows = np.repeat([0, 16, 32], len(t))
    t, x = np.tile(t, 3), np.tile(x, 3)
    order = np.argsort(t, kind="stable")
    dead = DeadTime(WIDTH, HEIGHT)
    assert not dead.known
    assert not dead.measure(
        EventArray.from_arrays(x[order], rows[order], t[order], np.zeros(len(t)))
    )
    assert dead.known


def test_without_a_pile_of_gaps_at_its_end_a_dead_time_hid_nothing() -> None:
    """As on a smooth dome under pixels of 0.6 ms: gaps begin at once, and go on as they began."""
    rng = np.random.default_rng(7)
    gaps = np.ceil((0.7 + rng.exponential(3.0, (60, WIDTH))) / 0.2).astype(np.int64) * (MS // 5)
    t, x = np.cumsum(gaps, axis=0).ravel(), np.tile(np.arange(WIDTH), 60)
    rows = np.repeat([0, 16, 32], len(t))
    t, x = np.tile(t, 3), np.tile(x, 3)
    order = np.argsort(t, kind="stable")
    dead = DeadTime(WIDTH, HEIGHT)
    assert not dead.measure(
        EventArray.from_arrays(x[order], rows[order], t[order], np.zeros(len(t)))
    )
    assert dead.known


def test_late_events_don_t_begin_to_stay_all_at_once() -> None:
    """They would look like an edge behind the edge."""
    dead = DeadTime(WIDTH, HEIGHT)
    assert dead.measure(passing(MS)[0])
    dead._last = np.zeros((HEIGHT, WIDTH), np.int64)
    y, x = np.mgrid[:HEIGHT, :WIDTH].reshape(2, -1)
    shares = []
    for gap_ms in (1.8, 2.2, 2.5, 2.8, 3.2):
        t = np.full(len(x), round(gap_ms * MS))
        dead._last = np.zeros((HEIGHT, WIDTH), np.int64)
        kept = dead.without_followers(EventArray.from_arrays(x, y, t, 0 * t), 0.5)
        shares.append(len(kept) / len(x))
    np.testing.assert_allclose(shares, [0.0, 0.25, 0.5, 0.75, 1.0], atol=0.05)


def test_what_comes_as_a_pixel_wakes_up_goes_however_the_stream_is_cut() -> None:
    events, shows = passing(MS)
    whole = DeadTime(WIDTH, HEIGHT)
    assert whole.measure(events)
    kept = whole.without_followers(events, 0.5)
    # But for noise, and what noise went before.
    assert abs(len(kept) - shows.sum()) < 150
    assert np.isin(kept.t_ns, events.t_ns[shows]).mean() > 0.99
    assert whole.left_out == len(events) - len(kept)
    assert whole.blind_m == pytest.approx(5e-4)
    parts = DeadTime(WIDTH, HEIGHT)
    parts.measure(events)
    cuts = [parts.without_followers(events[k : k + 999], 0.5) for k in range(0, len(events), 999)]
    np.testing.assert_array_equal(np.concatenate([c.t_ns for c in cuts]), kept.t_ns)


def test_all_stay_where_the_sensor_hardly_moves_meanwhile() -> None:
    events, _ = passing(MS)
    dead = DeadTime(WIDTH, HEIGHT)
    dead.measure(events)
    dead.without_followers(events, 0.5)
    before = dead.left_out
    assert dead.without_followers(events, 0.2) is events
    assert dead.left_out == before > 0
    assert dead.blind_m == 0.0


def test_windows_that_overlap_lose_the_same() -> None:
    events, _ = passing(MS)
    dead = DeadTime(WIDTH, HEIGHT)
    for _ in range(2):
        dead.measure(events)
        again = dead.without_followers(events, 0.5)
    once = DeadTime(WIDTH, HEIGHT)
    once.measure(events)
    np.testing.assert_array_equal(again.t_ns, once.without_followers(events, 0.5).t_ns)


def test_a_texture_keeps_most_rows_busy_and_an_object_does_not() -> None:
    rows, columns = np.mgrid[:HEIGHT, :WIDTH].reshape(2, -1)

    def seen(part: np.ndarray) -> EventArray:
        x, y = columns[part], rows[part]
        return EventArray.from_arrays(x, y, np.arange(len(x)), np.zeros(len(x)))

    texture = seen(np.full(len(rows), True))
    dead = DeadTime(WIDTH, HEIGHT)
    # Too little travel says nothing.
    assert not dead.textured(texture, 0.5e-3)
    dead.blind_m = 5e-4
    assert dead.textured(texture, 0.6e-3)
    assert dead.blind_m == 0.0
    assert dead.textured(seen(rows < HEIGHT * 4 // 5), 1e-3)
    assert not dead.textured(seen(rows < HEIGHT * 7 // 10), 1e-3)
