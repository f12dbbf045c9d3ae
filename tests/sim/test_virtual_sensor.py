import numpy as np
import pytest

from roller_sim import _sensor_kernels as kernels
from roller_sim.cell import VirtualCell
from roller_sim.sensor import EventSensor, unpack
from sim import virtual_twins as twins

SEED = np.uint64(77)


class Row:
    """A row of pixels fed with log intensities of the test's own."""

    def __init__(self, width=8, on=0.25, off=0.25, rate=0.0, timing=(0, 0, 0, 0, 0.5)):
        full = {"dtype": np.float32}
        self.signal, self.level = np.zeros(width, **full), np.zeros(width, **full)
        self.before = np.zeros(width, **full)
        self.on, self.off = np.full(width, on, **full), np.full(width, off, **full)
        self.rate = np.full(width, rate, **full)
        self.held, self.draws = np.zeros(width, np.int64), np.zeros(width, np.int64)
        self.noise = np.full(width, kernels.NEVER)
        self.timing = (*(np.int64(v) for v in timing[:4]), float(timing[4]))
        self.out = np.empty(width * kernels.MAX_PER_STEP, np.uint64)
        self.watch = None

    def step(self, t0, t1, new, tau=0.0, y=3):
        width = len(self.signal)
        if self.watch is None:
            self.watch = (*np.empty((2, 1, width), np.float32), np.empty((1, width), np.int64))
            state = (self.level, self.held, self.noise, self.on, self.off)
            kernels._watch_all(*(values[None] for values in state), self.watch)
        n = kernels._sensor_row(
            np.int64(t0), np.int64(t1), tau, np.asarray(new, np.float32), 0, y, width,
            self.before, self.signal, self.level, tuple(values[0] for values in self.watch),
            self.held, self.noise, self.draws, self.on, self.off, self.rate, self.timing, SEED,
            np.empty(width, np.float32), np.empty(width, np.bool_), self.out, 0,
        )  # fmt: skip
        return self.out[:n].copy()


def test_a_step_gives_as_many_events_as_it_holds_thresholds():
    row = Row(width=5)
    steps = np.array([0.20, 0.30, 0.80, -0.60, -0.10])
    words = row.step(0, 1_000_000, steps)
    x, y, t, p = unpack(words)
    np.testing.assert_array_equal(np.bincount(x, minlength=5), [0, 1, 3, 2, 0])
    assert set(y) == {3}
    np.testing.assert_array_equal(p, (steps[x] > 0).astype(int))
    # Crossings are found by linear interpolation.
    np.testing.assert_allclose(t[x == 2], np.array([0.25, 0.5, 0.75]) / 0.8 * 1e6, rtol=1e-4)


def test_no_more_than_the_most_events_at_once_but_none_is_lost():
    row = Row(width=1)
    first = row.step(0, 1000, [2.1])
    second = row.step(1000, 2000, [2.11])
    assert (len(first), len(second)) == (kernels.MAX_PER_STEP, 4)


def test_a_held_pixel_restarts_from_the_signal_it_finds():
    row = Row(width=1, timing=(0, 0, 500, 0, 0.5))
    assert len(row.step(0, 1000, [1.0])) == 2
    # Both events found level 0.25 and, let go at t = 750, the signal there.
    assert row.held[0] == 1500
    assert not len(row.step(1000, 1400, [1.6]))
    assert len(row.step(1400, 1600, [1.6])) == 0
    assert row.level[0] == pytest.approx(1.6, abs=1e-6)


def test_low_pass_answers_a_ramp_exactly_however_it_is_cut():
    tau = 10_000.0
    for cuts in (1, 2, 5):
        row = Row(width=1, on=10.0)
        for k in range(cuts):
            row.step(k * 20_000 // cuts, (k + 1) * 20_000 // cuts, [(k + 1) / cuts], tau)
        ramp = 1 - (1 - np.exp(-2)) / 2
        assert row.signal[0] == pytest.approx(ramp, abs=1e-6)
        row.step(20_000, 30_000, [1.0], tau)
        assert 1 - row.signal[0] == pytest.approx((1 - ramp) * np.exp(-1), abs=1e-6)


def test_sensor_kernel_equals_its_plain_python_twin():
    rng = np.random.default_rng(8)
    width, frames = 6, 120
    for timing in (
        (0, 0, 0, 0, 0.5),
        (100_000, 20_000, 100_000, 200_000, 0.6),
        (50_000, 0, 30_000, 0, 0.3),
    ):
        row = Row(width, timing=timing, rate=2000.0)
        row.on[:] = rng.uniform(0.2, 0.3, width)
        row.off[:] = rng.uniform(0.2, 0.3, width)
        row.noise[:] = rng.integers(0, 500_000, width)
        pixels = [
            twins.PixelTwin(3 * width + u, row.on[u], row.off[u], 2000.0, 0.0, 0.0,
                            row.noise[u], timing, int(SEED))
            for u in range(width)
        ]  # fmt: skip
        light = np.cumsum(rng.normal(0, 0.6, (frames, width)), axis=0).astype(np.float32)
        total = 0
        for k in range(frames):
            t0, t1 = 42_000 * k, 42_000 * (k + 1)
            x, _, t, p = unpack(row.step(t0, t1, light[k], tau=60_000.0))
            total += len(x)
            for u, pixel in enumerate(pixels):
                want = pixel.step(t0, t1, 60_000.0, light[k, u])
                got = list(zip(t[x == u].tolist(), p[x == u].tolist(), strict=True))
                assert len(got) == len(want)
                for (t_got, p_got), (t_want, p_want) in zip(got, want, strict=True):
                    assert p_got == p_want
                    assert abs(t_got - t_want) <= 2
        assert total > 80


def events_of(cell, threads=0, **changes):
    """All events of a cell's scan, packed, and its sensor."""
    settings = cell.settings.sensor.model_copy(update=changes)
    maps, truth = cell._maps, cell.truth
    sensor = EventSensor(cell._rays, maps, truth.roller, cell._light, settings, 5, threads)
    seconds = cell.path.frame_times(2e-5, 1e-3)
    cameras = cell.path.over_plate(seconds) * 1e3
    times = np.round(seconds * 1e9).astype(np.int64)
    sensor.start(cameras[0])
    words = [
        sensor.advance(cameras[a : a + 32], times[a : a + 32]) for a in range(1, len(times), 32)
    ]
    return np.concatenate(words), sensor


@pytest.fixture(scope="module")
def cell():
    return VirtualCell(twins.small("pyramid", camera={"width": 96, "height": 64}))


def test_results_do_not_depend_on_the_number_of_threads(cell):
    one, three = (events_of(cell, threads=n)[0] for n in (1, 3))
    np.testing.assert_array_equal(one, three)
    assert len(one) > 1000


def test_read_out_comes_in_frames_column_by_column(cell):
    words, _ = events_of(cell)
    x, y, t, _ = unpack(words)
    assert not (t % 200_000).any()
    order = np.lexsort((y, x, t))
    np.testing.assert_array_equal(order, np.arange(len(x)))
    # A pixel is latched until it is read out: at most one event a frame.
    place = np.stack([t, x.astype(np.int64) * 4096 + y])
    assert np.unique(place, axis=1).shape[1] == len(x)


def test_without_frames_times_are_fine_and_in_order(cell):
    _, _, t, _ = unpack(events_of(cell, readout_us=0.0)[0])
    assert (np.diff(t) >= 0).all()
    assert len(np.unique(t % 200_000)) > 100


def test_rate_cap_counts_what_it_cuts(cell):
    free, sensor = events_of(cell, rate_cap_mev_s=0.0)
    assert sensor.dropped == 0
    capped, limited = events_of(cell, rate_cap_mev_s=1.0)
    assert limited.dropped > 0
    assert limited.count == len(capped) == len(free) - limited.dropped
    frames = np.bincount(unpack(capped)[2] // 200_000)
    assert frames.max() == 200
    assert np.isin(capped, free).all()


def test_a_full_buffer_loses_nothing(cell, monkeypatch):
    whole, _ = events_of(cell, threshold=0.02, readout_us=0.0, refractory_us=0.0)
    monkeypatch.setattr("roller_sim.sensor._BUFFER_GROUPS", 1)
    tight, _ = events_of(cell, threshold=0.02, readout_us=0.0, refractory_us=0.0)
    np.testing.assert_array_equal(whole, tight)


def test_a_print_over_level_plate_gives_its_events_at_any_frame_rate(monkeypatch):
    printed = VirtualCell(
        twins.small(
            "flat", light={"speckle": 0.08}, sensor={"background_hz": 0.0, "hot_share": 0.0}
        )
    )
    count = sum(len(events) for _, events in printed.raw_events())
    monkeypatch.setattr("roller_sim.cell._STEP_PX", 0.125)
    fine = sum(len(events) for _, events in printed.raw_events())
    # Frames half a pixel apart miss what comes and goes between them, two pixels nearly half.
    assert fine > 10_000
    assert 0.9 < count / fine <= 1.0


def test_background_and_hot_pixels_have_the_rates_set():
    flat = VirtualCell(
        twins.small("flat", light={"speckle": 0.0}, motion={"hold_s": 0.5, "vibration_um": 0.0})
    )
    seconds = flat.duration_s
    words, _ = events_of(flat, background_hz=20.0, hot_share=0.0)
    pixels = 80 * 48
    assert len(words) / seconds / pixels == pytest.approx(20.0, rel=0.1)
    assert unpack(words)[3].mean() == pytest.approx(0.6, abs=0.02)
    words, _ = events_of(flat, background_hz=0.0, hot_share=0.01)
    x, y, *_ = unpack(words)
    noisy = np.unique(x.astype(int) * 4096 + y)
    assert 15 <= len(noisy) <= 70
    assert len(words) / seconds / len(noisy) > 250
    assert not len(events_of(flat, background_hz=0.0, hot_share=0.0)[0])
