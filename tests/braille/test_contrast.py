"""Contrast maximisation: what a wrong speed or depth leaves to read."""

import numpy as np
import pytest

from braille.synthetic import CAMERA, DEPTH_M, SETTINGS, Plate, over, read, scan
from roller_braille.batches import Batch, BatchCutter
from roller_braille.contrast import (
    MappedBatch,
    Sample,
    TravelScale,
    _grid,
    contrasts,
    warp_sample,
)
from roller_braille.reader_settings import BrailleSettings
from roller_braille.warp import F32, F64, OUTSIDE, Knots, Warp
from roller_core.events import EventArray
from roller_core.pose_track import PoseTrack

TEXT = "quick fox"


def stretched(track: PoseTrack, factor: float) -> PoseTrack:
    """Poses of a robot that says it goes so many times as fast as it does."""
    out = PoseTrack()
    origin = track.positions[0]
    for t, p, q in zip(track.times_ns, track.positions, track.quaternions, strict=True):
        out.append(int(t), np.asarray(origin + (p - origin) * factor), q)
    return out


def found(
    events: EventArray, track: PoseTrack, settings: BrailleSettings = SETTINGS
) -> TravelScale:
    """The scale found over a scan."""
    cutter, warp, travel = BatchCutter(settings, track), Warp(settings, CAMERA, track), None
    cutter.add(events)
    while (batch := cutter.cut(flush=True)) is not None:
        if isinstance(batch, Batch):
            travel = TravelScale(settings) if travel is None else travel
            knots = warp.knots(batch.roll, batch.start_ns, batch.end_ns)
            travel.add(MappedBatch(batch.events, knots), warp.table)
    assert travel is not None
    return travel


def contrasts_numpy(sample: Sample, scales: F64, px_m: float) -> F64:
    """The same as `contrasts`, without a compiled kernel."""
    first, shape = _grid(sample, scales, px_m)
    rows = np.floor((sample.down - first[1]) / px_m + 0.5).astype(np.int64)
    out = []
    for scale in scales:
        place = (sample.along + scale * sample.offset - first[0]) / px_m
        column = np.floor(place).astype(np.int64)
        image = np.zeros(shape)
        np.add.at(image, (rows, column), 1.0 - (place - column))
        np.add.at(image, (rows, column + 1), place - column)
        out.append(float((image**2).sum()))
    return np.array(out)


def test_the_kernel_counts_as_its_twin() -> None:
    rng = np.random.default_rng(3)
    along, offset, down = rng.uniform(-0.01, 0.01, (3, 500))
    scales = np.array([0.9, 1.0, 1.07])
    sample = Sample(along, offset, down)
    np.testing.assert_allclose(
        contrasts(sample, scales, 2e-4), contrasts_numpy(sample, scales, 2e-4), rtol=1e-12
    )


def warp_sample_numpy(events: EventArray, table: F32, knots: Knots) -> Sample:
    """The same as `warp_sample`, without a compiled kernel."""
    pixel = table[events.y, events.x].astype(np.float64)
    inside = pixel[:, 0] > OUTSIDE / 10
    pixel, t = pixel[inside], events.t_ns[inside]
    times, along = knots.times_ns, knots.along
    k = np.clip(np.searchsorted(times, t, "right") - 1, 0, len(times) - 2)
    f = (t - times[k]) / (times[k + 1] - times[k])
    h = np.einsum("nij,nj->ni", knots.maps[k], np.column_stack([pixel, np.ones(len(pixel))]))
    place = along[k] + f * (along[k + 1] - along[k])
    return Sample(place, h[:, 0] / h[:, 2] - along[k], h[:, 1] / h[:, 2])


def test_chosen_events_are_warped_as_by_the_twin() -> None:
    rng = np.random.default_rng(4)
    n, times = 400, np.array([0, 300, 301, 1000])
    x, y, t = rng.integers(0, 8, n), rng.integers(0, 6, n), np.sort(rng.integers(-5, 1005, n))
    events = EventArray.from_arrays(x, y, t, rng.integers(0, 2, n))
    table = rng.uniform(0, 8, (6, 8, 2)).astype(np.float32)
    table[2, 3], table[4, 5] = OUTSIDE, np.nan
    maps = np.eye(3) + rng.uniform(-0.01, 0.01, (4, 3, 3))
    knots = Knots(times, maps, np.sort(rng.uniform(0, 1e-3, 4)))
    given, expected = (warp(events, table, knots) for warp in (warp_sample, warp_sample_numpy))
    assert 0 < len(expected.along) < n
    for name in ("along", "offset", "down"):
        np.testing.assert_allclose(getattr(given, name), getattr(expected, name), rtol=1e-12)


@pytest.mark.parametrize("factor", [0.9, 0.97, 1.0, 1.1])
def test_the_factor_between_speed_and_events_is_found(factor: float) -> None:
    plate = Plate().text(TEXT)
    track = over(plate)
    travel = found(scan(plate, track, noise=20_000), stretched(track, factor))
    assert travel.scale == pytest.approx(factor, abs=0.005)


def test_a_factor_that_was_found_wrong_is_found_anew() -> None:
    """Poses say 5 % too much at first, as while the robot speeds up, then what is true."""
    plate = Plate().text(TEXT + " " + TEXT)
    track, poses = over(plate), PoseTrack()
    first, over_m = track.positions[0], 0.04
    for t, p, q in zip(track.times_ns, track.positions, track.quaternions, strict=True):
        travel = p[0] - first[0]
        p = p + [0.05 * min(travel, over_m), 0.0, 0.0]
        poses.append(int(t), p, q)
    events = scan(plate, track)
    early = events[events.t_ns < track.times_ns[np.searchsorted(track.positions[:, 0], 0.015)]]
    assert found(early, poses).scale == pytest.approx(1.05, abs=0.01)
    assert found(events, poses).scale == pytest.approx(1.0, abs=0.005)


def test_a_wrong_depth_is_found_too() -> None:
    plate = Plate().text(TEXT)
    track = over(plate)
    settings = BrailleSettings.create({"depth_m": DEPTH_M * 1.05})
    travel = found(scan(plate, track), track, settings)
    assert travel.scale == pytest.approx(1 / 1.05, abs=0.005)


def test_noise_alone_says_nothing() -> None:
    plate = Plate()
    track = over(Plate().text(TEXT))
    assert found(scan(plate, track, noise=300_000), track).scale is None


@pytest.mark.parametrize("back", [False, True])
@pytest.mark.parametrize("factor", [0.9, 1.1])
def test_text_is_read_at_a_wrong_speed(factor: float, back: bool) -> None:
    plate = Plate().text(TEXT)
    track = over(plate, back=back)
    events = scan(plate, track, noise=20_000)
    cells, pipeline = read(events, stretched(track, factor))
    assert pipeline.text() == [TEXT]
    # Cells lie where the poses say that they are.
    x = np.array([c.position[0] for c in cells])
    origin = track.positions[0, 0]
    true = np.arange(len(cells)) * SETTINGS.spacing.cell_pitch_m + SETTINGS.spacing.dot_pitch_m / 2
    assert np.abs(x - (origin + (true - origin) * factor)).max() < 1e-3
    # The same poses with nothing put right: the test tries something.
    _, without = read(events, stretched(track, factor), max_scale_error=0.0)
    assert without.text() != [TEXT]


@pytest.mark.parametrize("error_m", [-1e-3, 1e-3])
def test_text_is_read_at_a_wrong_depth(error_m: float) -> None:
    plate = Plate().text(TEXT)
    track = over(plate)
    _, pipeline = read(scan(plate, track), track, depth_m=DEPTH_M + error_m)
    assert pipeline.text() == [TEXT]


def test_batches_come_out_in_order_and_all_of_them() -> None:
    travel, given = TravelScale(SETTINGS), []
    for n in range(12):
        times = np.array([n, n + 1], np.int64) * 1_000_000
        along = np.array([n, n + 1.0]) * 3e-3
        knots = Knots(times, np.tile(np.eye(3), (2, 1, 1)), along)
        given += travel.add(MappedBatch(EventArray.empty(), knots), np.zeros((1, 1, 2), np.float32))
        # What waits is bounded by travel.
        assert n + 1 - len(given) <= 8
    # A batch over poses that lie far apart is itself longer than that.
    far = Knots(np.array([12, 13]) * 1_000_000, np.tile(np.eye(3), (2, 1, 1)), np.array([0.1, 0.3]))
    given += travel.add(MappedBatch(EventArray.empty(), far), np.zeros((1, 1, 2), np.float32))
    given += travel.release()
    assert [int(f.knots.times_ns[0]) for f in given] == [n * 1_000_000 for n in range(13)]
