"""Where rays meet the plane of the surface sweep, and the store of its events, by slow forms."""

import numpy as np

from roller_core.events import EventArray
from roller_core.transforms import F64, pose_matrix, rotation_vector_to_quaternion
from roller_emvs.methods.surface import _event_kernels
from roller_emvs.methods.surface._event_kernels import PIECES
from roller_emvs.methods.surface.event_store import EventStore


def place(
    events: EventArray, pixels: np.ndarray, first: F64, second: F64, steepest: float = np.inf
) -> tuple[np.ndarray, tuple[float, float, float]]:
    out = np.full((3, len(events) + 5), 99.0, np.float32)
    span = _event_kernels._place(
        events.x, events.y, events.t_ns, pixels, 1000, 9000, first, second, 0.045, steepest, out
    )
    return out[:, : len(events)], span


def test_rays_meet_the_plane_and_those_that_lean_too_far_are_left_out() -> None:
    rng = np.random.default_rng(0)
    pixels = rng.uniform(-0.3, 0.3, (20, 30, 2)).astype(np.float32)
    events = EventArray.from_arrays(
        rng.integers(0, 30, 1100), rng.integers(0, 20, 1100),
        np.sort(rng.integers(1000, 9000, 1100)), np.zeros(1100, int),
    )  # fmt: skip
    first = pose_matrix(np.array([0.01, 0.002, 0.0]), rotation_vector_to_quaternion([0, 0.1, 0.0]))
    second = pose_matrix(
        np.array([0.012, 0.001, 0.001]), rotation_vector_to_quaternion([0.02, 0.1, 0.01])
    )
    out, _ = place(events, pixels, first, second)
    expected = np.empty((3, 1100))
    for i in range(1100):
        pose = first + (events.t_ns[i] - 1000) / 8000 * (second - first)
        d = pose[:3, :3] @ [*pixels[events.y[i], events.x[i]].astype(float), 1.0]
        point = pose[:3, 3] + d / d[2] * (0.045 - pose[2, 3])
        expected[:, i] = [point[0] - 0.01, point[1], d[0] / d[2]]
    np.testing.assert_allclose(out, expected, atol=1e-8, rtol=1e-5)
    out, (low, high, most) = place(events, pixels, first, second, 0.2)
    inside = np.abs(expected[2]) <= 0.2
    np.testing.assert_array_equal(np.isfinite(out[0]), inside)
    assert (low, high) == (out[0, inside].min(), out[0, inside].max())
    assert most == np.abs(out[2, inside]).max()


def test_a_ray_that_looks_away_has_no_place() -> None:
    events = EventArray.from_arrays([0], [0], [1000], [0])
    away = np.diag([1.0, -1.0, -1.0, 1.0])
    out, (low, high, _) = place(events, np.zeros((1, 1, 2), np.float32), away, away)
    assert np.isnan(out[0, 0])
    assert low > high


#: Largest slope of the stores; what a place of theirs is off by at most, of blocks of 4 mm, and a
#: slope.
STEEPEST = 0.5
PLACE, SLOPE = 0.004 / PIECES / 65536, 1.01 * STEEPEST / 65536


def test_the_store_holds_each_event_once_and_reuses_what_is_released() -> None:
    rng = np.random.default_rng(2)
    length, low, start_ns = 0.004, -2, 10**15
    store = EventStore(length, STEEPEST)
    n = 30_000
    x = rng.uniform(-0.010, 0.018, n).astype(np.float32)
    x[7] = np.nan
    y, slope = rng.uniform(-0.3, 0.3, (2, n)).astype(np.float32)
    t = start_ns + np.sort(rng.integers(0, 10**9, n))
    p = rng.integers(0, 2, n)
    events = EventArray.from_arrays(np.zeros(n, int), np.zeros(n, int), t, p)
    placed = np.stack([x, y, slope])
    # In two goes, of which the second has more room than it fills.
    half = n // 2
    store.add(placed[:, :half].copy(), events[:half], -low * length, low, range(low, 4))
    wide = np.full((3, n), 9.0, np.float32)
    wide[:, : n - half] = placed[:, half:]
    store.add(wide, events[half:], -low * length, low, range(low, 4))
    number = np.floor(x.astype(float) / length)
    assert store.held == np.sum((number >= low) & (number < 4))
    assert store.blocks == list(range(low, 4))
    for k in range(low, 4):
        own = number == k
        assert store.count(k) == own.sum()
        assert store.times(k) == (t[own].min(), t[own].max())
        np.testing.assert_allclose(
            store.span(k),
            [x[own].min() - k * length, x[own].max() - k * length, y[own].min(), y[own].max()],
            atol=PLACE,
        )
        for polarity in range(2):
            found = store.events(k, polarity, 0.001)
            # Those of a piece lie together.
            piece = np.floor(
                store.events(k, polarity).x_m * (np.float32(PIECES) / np.float32(length))
            )
            assert np.all(np.diff(piece) >= 0)
            held = np.flatnonzero(own & (p == polarity))
            held, order = held[np.argsort(y[held])], np.argsort(found.y_m)
            np.testing.assert_allclose(found.x_m[order], x[held] - k * length + 0.001, atol=PLACE)
            np.testing.assert_array_equal(found.y_m[order], y[held])
            np.testing.assert_allclose(found.slope[order], slope[held], atol=SLOPE)
            inner = store.chains(k, polarity, 0.0016, 0.0024)[2].sum()
            assert inner == np.sum((piece >= 3) & (piece <= 4))
    pages = len(store.link)
    kept = store.events(1, 1)
    for k in (-2, -1, 0):
        assert store.release(k) == np.sum(number == k)
    store.add(placed, events, -low * length, low, [0])
    assert len(store.link) == pages
    assert store.count(0) == np.sum(number == 0)
    np.testing.assert_array_equal(store.events(1, 1).x_m, kept.x_m)
    assert len(store.events(-1, 0)) == 0


def test_blocks_that_no_event_came_to_are_forgotten_too() -> None:
    store, placed = EventStore(0.004, STEEPEST), np.array([[0.001], [0.0], [0.0]], np.float32)
    events = EventArray.from_arrays([0], [0], [5], [1])
    store.add(placed, events, 0.0, 0, range(4))
    store.release_before(0)
    assert store.blocks == [0]
    store.release_before(3)
    assert store.blocks == []
    assert store.held == 0
    assert list(store._slots) == [3]
