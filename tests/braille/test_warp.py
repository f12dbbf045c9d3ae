"""Motion compensation against what is known analytically; the kernel against its twin."""

import numpy as np
import pytest

from braille.synthetic import CAMERA, DEPTH_M, DOWN, START_NS, roll_track
from roller_braille.kinds import Kind
from roller_braille.reader_settings import BrailleSettings
from roller_braille.strip import Strip
from roller_braille.warp import F32, F64, I64, OUTSIDE, Knots, PixelTable, Warp, vote
from roller_core.camera import Camera
from roller_core.events import EventArray
from roller_core.passes import Pass
from roller_core.transforms import quaternion_to_matrix, rotation_vector_to_quaternion

RASTER = np.array([[1e4, 0.0, 250.0], [0.0, 1e4, 110.0], [0.0, 0.0, 1.0]])


def forward(origin: float = 0.0, direction: int = 1) -> Pass:
    return Pass(DOWN, np.array([origin, 0.0, DEPTH_M]), direction)


def a_point(track, x: float, y: float, camera: Camera = CAMERA) -> EventArray:
    """A point of the plate seen at many times."""
    t = np.linspace(track.start_ns, track.end_ns, 2000).astype(np.int64)
    pose = np.linalg.inv(track.matrices(t))
    place = np.einsum("nij,j->ni", pose, [x, y, 0.0, 1.0])[:, :3]
    u, v = camera.project(place).T
    seen = (u > 0) & (u < camera.width - 1) & (v > 0) & (v < camera.height - 1)
    n = int(seen.sum())
    return EventArray.from_arrays(np.round(u[seen]), np.round(v[seen]), t[seen], np.zeros(n))


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("tilt", [0.0, 0.01])
def test_a_moving_point_collapses(direction: int, tilt: float) -> None:
    """2000 events spread over 400 px come to lie within a pixel of the point's place."""
    turned = DOWN @ quaternion_to_matrix(rotation_vector_to_quaternion([tilt, tilt, 0.0]))
    ends = [-0.008, 0.008] if direction > 0 else [0.008, -0.008]
    track = roll_track(ends, [0.0, 0.05], rotation=turned)
    events = a_point(track, 0.002, 0.003)
    assert np.ptp(events.x.astype(int)) > 300
    warp = Warp(BrailleSettings.create({}), CAMERA, track)
    roll = forward(0.0, direction)
    strip = np.zeros((2, 220, 500), np.float32)
    newest = np.zeros(500, np.int64)
    knots = warp.knots(roll, track.start_ns, track.end_ns)
    used = vote(events, warp.table, knots, RASTER, strip, newest)
    assert used == len(events)
    rows, columns = np.nonzero(strip[0])
    along, down = (columns - 250) * 1e-4 * direction, (rows - 110) * 1e-4
    # A pixel is 0.043 mm; tilted, the surface seen is not the one assumed.
    allowed = 1.5e-4 if tilt == 0 else 8e-4
    np.testing.assert_allclose(along, 0.002, atol=allowed)
    np.testing.assert_allclose(down, -0.003, atol=allowed)
    assert np.ptp(columns) <= (2 if tilt == 0 else 4)
    assert newest[columns].max() == events.t_ns[-1]
    points = warp.surface_points(roll, [0.002 * direction], [-0.003], DEPTH_M)
    np.testing.assert_allclose(points, [[0.002, 0.003, 0.0]], atol=1e-12)


def test_ramps_are_compensated_by_the_travel_not_the_speed() -> None:
    x = np.linspace(0, 1, 30) ** 2 * 0.016 - 0.008
    track = roll_track(x, np.linspace(0, 0.2, 30))
    warp = Warp(BrailleSettings.create({}), CAMERA, track)
    strip, newest = np.zeros((2, 220, 500), np.float32), np.zeros(500, np.int64)
    events = a_point(track, 0.0, 0.0)
    vote(events, warp.table, warp.knots(forward(), START_NS, track.end_ns), RASTER, strip, newest)
    assert np.ptp(np.nonzero(strip[0])[1]) <= 2


def test_lens_distortion_is_taken_out() -> None:
    camera = Camera(480, 440, 1066.0, 1066.0, 239.5, 219.5, (-0.3, 0.1, 0.001, -0.001, 0.0))
    track = roll_track([-0.007, 0.007], [0.0, 0.05])
    warp = Warp(BrailleSettings.create({}), camera, track)
    strip, newest = np.zeros((2, 220, 500), np.float32), np.zeros(500, np.int64)
    events = a_point(track, 0.001, 0.006, camera)
    knots = warp.knots(forward(), track.start_ns, track.end_ns)
    vote(events, warp.table, knots, RASTER, strip, newest)
    rows, columns = np.nonzero(strip[0])
    assert np.ptp(columns) <= 2
    assert np.ptp(rows) <= 2


def vote_numpy(
    events: EventArray, table: F32, knots: Knots, raster: F64, strip: F32, newest: I64
) -> int:
    """The same as `vote`, without a compiled kernel."""
    maps = raster @ knots.maps
    pixel = table[events.y, events.x].astype(np.float64)
    inside = pixel[:, 0] > OUTSIDE / 10
    t, p, pixel = events.t_ns[inside], events.p[inside], pixel[inside]
    k = np.clip(np.searchsorted(knots.times_ns, t, "right") - 1, 0, len(knots.times_ns) - 2)
    f = (t - knots.times_ns[k]) / (knots.times_ns[k + 1] - knots.times_ns[k])
    m = maps[k] * (1 - f)[:, None, None] + maps[k + 1] * f[:, None, None]
    h = np.einsum("nij,nj->ni", m, np.column_stack([pixel, np.ones(len(pixel))]))
    place = np.floor(h[:, :2] / h[:, 2:] + 0.5).astype(np.int64)
    _, rows, columns = strip.shape
    ok = ((place >= 0) & (place < [columns, rows])).all(axis=1)
    np.add.at(strip, (p[ok], place[ok, 1], place[ok, 0]), 1.0)
    newest[place[ok, 0]] = t[ok]
    return int(ok.sum())


@pytest.mark.parametrize("seed", range(5))
def test_kernel_equals_its_twin(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n = 5000
    tilt = rotation_vector_to_quaternion(rng.normal(0, 0.02, 3))
    track = roll_track([-0.01, 0.01], [0.0, 0.1], rotation=DOWN @ quaternion_to_matrix(tilt))
    warp = Warp(BrailleSettings.create({"view_half_width_m": 0.006}), CAMERA, track)
    assert (warp.table[..., 0] == OUTSIDE).any()
    events = EventArray.from_arrays(
        rng.integers(0, CAMERA.width, n),
        rng.integers(0, CAMERA.height, n),
        rng.integers(track.start_ns, track.end_ns, n),
        rng.integers(0, 2, n),
    ).sorted_by_time()
    knots = warp.knots(forward(), track.start_ns, track.end_ns)
    out = []
    for function in (vote, vote_numpy):
        # A strip smaller than the view: events beyond it are left out.
        strip, newest = np.zeros((2, 150, 300), np.float32), np.zeros(300, np.int64)
        used = function(events, warp.table, knots, RASTER, strip, newest)
        assert used == strip.sum()
        out.append((strip, newest))
    np.testing.assert_array_equal(out[0][0], out[1][0])
    np.testing.assert_array_equal(out[0][1], out[1][1])
    assert 0 < out[0][0].sum() < n


def test_strip_makes_up_for_a_view_that_was_short() -> None:
    """Columns where the pass begins are seen over less travel than those after it."""
    track = roll_track([0.0, 0.05], [0.0, 0.25])
    settings = BrailleSettings.create({})
    warp = Warp(settings, CAMERA, track)
    rng = np.random.default_rng(0)
    n = 300_000
    events = EventArray.from_arrays(
        rng.integers(0, CAMERA.width, n),
        rng.integers(0, CAMERA.height, n),
        np.sort(rng.integers(track.start_ns, track.end_ns, n)),
        np.zeros(n),
    )
    strip = Strip(settings, warp.half_height_m)
    strip.add(events, warp.table, warp.knots(forward(), track.start_ns, track.end_ns))
    a, b = strip.exposure.seen
    end = float(track.positions[-1, 0])
    assert (a, strip.exposure.complete) == (-208, int((end - settings.read_at_m) / 6e-5))
    assert strip.exposure.half_seen == int(end / 6e-5)
    assert b - a == pytest.approx((end + 0.025) / 6e-5, abs=2)
    means = [strip.image(c, c + 50, Kind.OFF)[60:-60].mean() for c in (0, 200, 400)]
    assert means[0] == pytest.approx(means[2], rel=0.1)
    assert strip.image(a, b, Kind.ON).sum() == 0
    assert strip.image(0, 400, Kind.BOTH).sum() == strip.image(0, 400, Kind.OFF).sum()
    assert strip.newest_ns(a, b) == events.t_ns[-1]
    before = strip.image(600, 700, Kind.OFF)
    strip.forget_before(590)
    np.testing.assert_array_equal(strip.image(600, 700, Kind.OFF), before)
    assert strip.image(0, 100, Kind.OFF).sum() == 0


def test_part_of_a_coatings_image_is_cut_out_of_it_until_more_is_seen() -> None:
    track = roll_track([0.0, 0.02], [0.0, 0.1])
    settings = BrailleSettings.create({})
    warp = Warp(settings, CAMERA, track)
    strip = Strip(settings, warp.half_height_m)
    strip.ground.settle(printed=True)
    rng = np.random.default_rng(0)
    n = 50_000
    half_ns = (track.end_ns - track.start_ns) // 2

    def see(start_ns: int) -> None:
        x, y = rng.integers(0, CAMERA.width, n), rng.integers(0, CAMERA.height, n)
        t = np.sort(rng.integers(start_ns, start_ns + half_ns, n))
        events = EventArray.from_arrays(x, y, t, rng.integers(0, 2, n))
        strip.add(events, warp.table, warp.knots(forward(), start_ns, start_ns + half_ns))

    see(track.start_ns)
    before = strip.image(0, 90, Kind.ON)
    np.testing.assert_array_equal(strip.image(0, 90, Kind.ON, 100, 180), before[100:180])
    see(track.start_ns + half_ns)
    whole, off = strip.image(0, 90, Kind.ON), strip.image(0, 90, Kind.OFF)
    assert (whole != before).any()
    np.testing.assert_array_equal(strip.image(0, 90, Kind.ON, 3, 40), whole[3:40])
    assert not (whole * off).any()
    n = 0
    see(track.start_ns + half_ns)
    strip.image(30, 60, Kind.ON)  # what lies on either side of a part comes to the same
    np.testing.assert_allclose(strip.image(0, 90, Kind.ON), whole, atol=1e-4)


def test_hot_pixels_are_found_and_those_that_see_something_kept() -> None:
    rng = np.random.default_rng(0)
    table = CAMERA.undistortion_table()
    pixels = PixelTable(table)
    for _ in range(5):
        n = 40_000
        x, y = rng.integers(0, CAMERA.width, n), rng.integers(0, CAMERA.height, n)
        # A busy row, as of a line of dots, and a hot pixel in a quiet one.
        y[: n // 4] = 100
        x[-10:], y[-10:] = 77, 200
        pixels.add(EventArray.from_arrays(x, y, np.arange(n), np.zeros(n)))
    assert pixels.hot_pixels == 1
    assert pixels.table[200, 77, 0] == OUTSIDE
    assert np.count_nonzero(pixels.table != table) == 1


def test_a_view_along_the_surface_is_left_out() -> None:
    """Poses of a stranger may turn the camera on its back between two knots."""
    maps = np.stack([np.eye(3), np.diag([1.0, 1.0, -1.0])])
    knots = Knots(np.array([0, 10]), maps, np.zeros(2))
    table = np.ones((1, 1, 2), np.float32)
    no = np.zeros(4)
    # The second lies halfway; the third goes back to before the first.
    events = EventArray.from_arrays(no, no, [1, 5, 0, 2], no)
    strip, newest = np.zeros((2, 4, 4), np.float32), np.zeros(4, np.int64)
    assert vote(events, table, knots, np.eye(3), strip, newest) == 3
    assert strip.sum() == 3
