"""Contrast maximisation: what a wrong speed or depth leaves to read."""

import numpy as np
import pytest

from braille.synthetic import CAMERA, DEPTH_M, SETTINGS, Plate, over, read, scan
from roller_braille.batches import Batch, BatchCutter
from roller_braille.contrast import MappedBatch, Sample, TravelScale, _grid, contrasts
from roller_braille.reader_settings import BrailleSettings
from roller_braille.warp import F64, Knots, Warp
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


@pytest.mark.parametrize("factor", [0.9, 0.97, 1.0, 1.1])
def test_the_factor_between_speed_and_events_is_found(factor: float) -> None:
    plate = Plate().text(TEXT)
    track = over(plate)
    travel = found(scan(plate, track, noise=20_000), stretched(track, factor))
    assert travel.scale == pytest.approx(factor, abs=0.005)


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
