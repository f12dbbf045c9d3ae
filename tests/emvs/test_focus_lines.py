"""Points of `focus` follow lines where edges lie apart and were seen over most of a crossing."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from roller_core.events import EventArray
from roller_emvs.depth_map import DepthMap
from roller_emvs.depth_settings import DepthSettings
from roller_emvs.evidence import Relief, find_depths, measured_pixels
from roller_emvs.evidence.evidence_settings import FocusEvidence
from roller_emvs.lines.edge_drift import EdgeDriftSettings
from roller_emvs.lines.fit import ROW_STEP, TEXTURE_ROW_STEP
from roller_emvs.lines.line_points import LinePoints
from roller_emvs.lines.ray_source import RayArray
from roller_emvs.lines.refine import refine
from roller_emvs.lines.travelling_light import TravellingLight
from roller_emvs.methods import _focus_kernels, focus
from roller_emvs.methods.focus import focus_depth
from roller_emvs.methods.window_field import WindowView
from roller_emvs.pipeline import DepthPipeline
from roller_emvs.rays import Packets, make_packets, rays_in_view
from roller_emvs.stopwatch import Stopwatch

from .scenes import CAMERA, MS, events_of, lines, rolling, tilted_scan, track_of

TABLE = CAMERA.undistortion_table()
#: Edges, 0.4 mm apart, of which every second lies higher by this, m.
STEP_M, PITCH_M = 8e-5, 4e-4


def steps(x: np.ndarray) -> np.ndarray:
    """Depth of lines on a plate, every second one raised."""
    return 0.045 - STEP_M * (np.unique(x, return_inverse=True)[1].reshape(x.shape) % 2)


def packets_of(duration_s: float, of_steps: bool = False) -> Packets:
    events = tilted_scan(0.12)
    if of_steps:
        events = events_of(lines(steps, PITCH_M), rolling(0.3), 0.12)
    track = track_of(rolling(0.3), 0.12)
    return make_packets(events[events.t_ns < duration_s * 1e9], TABLE, track, 64)


def depth_of(packets: Packets, at_s: float) -> tuple[np.ndarray, dict[str, float]]:
    watch = Stopwatch()
    view = track_of(rolling(0.3), 0.12).matrices([round(at_s * 1e9)])[0]
    depth = focus_depth(packets, CAMERA, view, DepthSettings.create({"threads": 1}), watch)[0]
    return depth, watch.milliseconds


@given(every=st.integers(1, 7), size=st.integers(1, 90), most=st.integers(1, 600))
def test_a_sample_holds_every_so_manyth_event_at_its_own_pose(
    every: int, size: int, most: int
) -> None:
    events, track = tilted_scan(0.12)[:most], track_of(rolling(0.3), 0.12)
    packets = make_packets(events, TABLE, track, size)
    some, view = packets.sample(every), np.eye(4)
    assert some.starts[-1] == len(some.events) == -(-len(events) // every)
    of_all, of_some = (rays_in_view(p, CAMERA, view).rays for p in (packets, some))
    np.testing.assert_array_equal(of_some, of_all[::every])


def test_lines_tell_heights_apart_that_a_neighbourhood_levels(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    packets, errors = packets_of(0.09, of_steps=True), {}
    x = np.unique(lines(steps, PITCH_M)[:, 0])
    for with_lines in (True, False):
        monkeypatch.setattr(focus, "is_textured", lambda *_, lines=with_lines: not lines)
        depth, spent = depth_of(packets, 0.045)
        assert ("lines" in spent) == with_lines
        row, column = np.nonzero(np.isfinite(depth))
        found = depth[row, column].astype(np.float64)
        place = (column - CAMERA.cx) / CAMERA.fx * found + 0.3 * 0.045
        away = np.abs(x - place[:, None])
        error = np.abs(found - (0.045 - STEP_M * (away.argmin(axis=1) % 2)))
        # Where the edges were seen over their whole crossing.
        errors[with_lines] = error[(away.min(axis=1) < 4e-5) & (np.abs(column - CAMERA.cx) < 50)]
    assert len(errors[True]) == len(errors[False]) > 500
    assert np.mean(errors[True]) < 0.7 * np.mean(errors[False])


def test_a_short_way_gives_no_lines() -> None:
    assert "lines" in depth_of(packets_of(0.09), 0.045)[1]
    assert "lines" not in depth_of(packets_of(0.03), 0.015)[1]


def textured_scan(duration_s: float) -> EventArray:
    """Spots everywhere on a plate, each seen in both polarities."""
    rng, way_m = np.random.default_rng(5), 0.3 * duration_s
    count = round(1.5e5 * (way_m + 0.02))
    x, y = rng.uniform(-0.01, way_m + 0.01, count), rng.uniform(-0.0036, 0.0036, count)
    seen = events_of(np.stack([x, y, np.full(count, 0.045)], axis=1), rolling(0.3), duration_s)
    twice = seen[np.repeat(np.arange(len(seen)), 2)]
    return EventArray.from_arrays(twice.x, twice.y, twice.t_ns, np.arange(len(twice)) % 2)


def test_under_a_texture_windows_are_shorter_and_no_lines_fitted() -> None:
    settings = DepthSettings.create({"threads": 1})
    pipeline = DepthPipeline(settings, CAMERA, track_of(rolling(0.3), 0.22))
    pipeline.add_events(textured_scan(0.22))
    maps = [found for found in pipeline.results(flush=True) if isinstance(found, DepthMap)]
    spans = [0.3 * (found.end_ns - found.start_ns) * 1e-9 for found in maps]
    assert len(maps) >= 3
    np.testing.assert_allclose(spans[:-1], [0.028] + [0.02] * (len(maps) - 2), rtol=1e-3)
    assert not any("lines" in found.milliseconds for found in maps)
    assert min(found.points for found in maps) > 1000
    steps_m = 0.3e-9 * np.diff([found.start_ns for found in maps])
    np.testing.assert_allclose(steps_m[1:], 0.015, rtol=1e-3)


@given(travel=st.floats(0.001, 0.1), overlap=st.one_of(st.just(-1.0), st.floats(0.0, 0.9)))
def test_windows_under_a_texture_are_shorter_and_repeat_what_is_asked_for(
    travel: float, overlap: float
) -> None:
    own = DepthSettings.create({"window": {"travel_m": travel, "overlap": overlap}})
    (plain, plain_step), (length, step) = own.travel_and_step_m(False), own.travel_and_step_m(True)
    assert plain == travel
    assert length == pytest.approx(5 / 7 * travel)
    assert plain_step == pytest.approx(plain * (1 - (0.4 if overlap < 0 else overlap)))
    assert step == pytest.approx(length * (1 - (0.25 if overlap < 0 else overlap)))


def refined(*, as_points: bool, textured: bool = False) -> tuple[Relief, Relief, LinePoints]:
    """Points of steps in light that stands still, those refined by lines, and the lines."""
    packets = packets_of(0.09, of_steps=True)
    view = track_of(rolling(0.3), 0.12).matrices([45 * MS])[0]
    seen = WindowView.of(packets, CAMERA, view, (0.0430, 0.0470))
    field, settings, still = seen.ray_field(), FocusEvidence.create({}), TravellingLight()
    drift = EdgeDriftSettings.create({})
    # Lines that say that the light stands still: as many as chance lets lean.
    still.add(np.zeros(100), np.full(100, 0.02), np.full(100, 1e4))
    depths = find_depths(field, -seen.half, seen.half, settings)
    found = measured_pixels(field, depths, settings, drift, textured=textured)
    columns = 0, field.shape[1]
    moved, lines = refine(
        field, found, lambda k: RayArray(field.some(k)), columns, drift, still, 0.0, 1,
        as_points=as_points,
    )  # fmt: skip
    return found, moved, lines


def test_fewer_lines_under_a_texture_move_points_as_far() -> None:
    found, plain, lines = refined(as_points=False)
    _, printed, fewer = refined(as_points=False, textured=True)
    assert set(lines.row % ROW_STEP) == set(fewer.row % TEXTURE_ROW_STEP) == {0}
    assert len(fewer.row) == pytest.approx(len(lines.row) * ROW_STEP / TEXTURE_ROW_STEP, rel=0.1)
    moves = [points.offset - found.offset for points in (plain, printed)]
    assert np.std(moves[0]) > 0
    slope = (moves[0] @ moves[1]) / (moves[0] @ moves[0])
    assert slope == pytest.approx(1.0, abs=0.01)
    assert np.median(printed.sigma / plain.sigma) == pytest.approx(1.0, abs=0.01)


def test_lines_become_points_beside_those_that_were_there() -> None:
    found, moved, lines = refined(as_points=False)
    _, both, _ = refined(as_points=True)
    shape = found.surfaces[0].shape
    n = len(found.row)
    assert len(moved.row) == n < len(both.row) <= n + 2 * len(lines.row)
    for name in ("row", "column", "offset", "sigma"):
        np.testing.assert_array_equal(getattr(both, name)[:n], getattr(moved, name))
    # A line has a point beside it, and is surer than that.
    sigma = np.full((*shape, 3), np.inf)
    for shift in (-1, 0, 1):
        sigma[moved.row, np.clip(moved.column + shift, 0, shape[1] - 1), shift] = moved.sigma
    beside = sigma.min(axis=2)[both.row[n:], np.rint(both.column[n:]).astype(int)]
    assert np.isfinite(beside).all()
    assert (both.sigma[n:] < beside).all()


def test_points_within_the_image_and_the_range_are_put_into_images() -> None:
    rng = np.random.default_rng(3)
    pixels = rng.permutation(24 * 32)[:200]
    row, column = pixels // 32, pixels % 32
    offset = rng.uniform(-1.2, 1.2, 200)
    sure, own, agreed = rng.uniform(0.1, 1.0, (3, 200)).astype(np.float32)
    found = np.full((3, 20, 30), np.float32(np.nan))
    points = (row, column, offset, sure, own, agreed)
    _focus_kernels._write(*points, 22.0, 1.0, *found)
    expected = np.full_like(found, np.nan)
    keep = (row < 20) & (column < 30) & (np.abs(offset) <= 1.0)
    z = (1 / (22.0 + offset[keep])).astype(np.float32)
    expected[:, row[keep], column[keep]] = z, sure[keep], (own * agreed)[keep] * z**2
    np.testing.assert_array_equal(found, expected)
