"""The sweep where pixels are blind for a while after an event."""

import numpy as np
import pytest

from emvs.scenes import CAMERA, MS, lines, rolling, tilted, tilted_scan, track_of, waking
from emvs.sweeps import DURATION_S, points_of, settings, sweep
from roller_core.dead_time import DeadTime
from roller_core.events import EventArray
from roller_emvs.lines import refine
from roller_emvs.methods.surface import SurfaceSweep


@pytest.fixture(scope="module")
def scan() -> EventArray:
    return tilted_scan(DURATION_S)


def test_what_pixels_tell_when_they_wake_up_is_no_edge(scan: EventArray) -> None:
    events = waking(scan, MS)
    patches, _, engine = sweep(events, track_of(rolling(0.3), DURATION_S))
    points = points_of(patches)
    edges = np.unique(lines(tilted)[:, 0])
    away = np.abs(points[:, 0, None] - edges).min(axis=1)
    assert len(points) > 1000
    # They lie 0.3 mm behind.
    assert np.mean(away < 1e-4) > 0.98
    assert engine.counts.dead_time_events > 0.4 * len(events)


def test_a_pass_waits_until_it_is_known_how_long_pixels_are_blind(scan: EventArray) -> None:
    """Its first events are looked at like all others."""
    events, track = waking(scan, MS), track_of(rolling(0.3), DURATION_S)
    few = events[events.x % 16 == 0]
    _, _, engine = sweep(few, track)
    informed = DeadTime(CAMERA.width, CAMERA.height)
    informed.measure(few)
    informed.without_followers(few, 0.3)
    assert engine.counts.dead_time_events == pytest.approx(informed.left_out, rel=0.01)
    # Where none is known after the first view's length nothing waits any longer.
    some = few[::20]
    engine = SurfaceSweep(settings(), CAMERA, track)
    engine.add_events(some)
    assert list(engine.results())
    assert engine.held_events < len(some)


def test_where_pixels_were_blind_light_isn_t_known_to_stand_still(scan: EventArray) -> None:
    """One event a wall doesn't get denser; a pixel that isn't blind for long tells more."""
    track = track_of(rolling(0.3), DURATION_S)
    blind, seeing = (sweep(waking(scan, ns), track)[0] for ns in (MS, MS // 2))
    assert min(np.concatenate([patch.sigma for patch in blind])) > 1.2e-4
    assert np.median(np.concatenate([patch.sigma for patch in seeing])) < 1e-4


def test_points_are_less_sure_where_pixels_were_blind(
    scan: EventArray, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By a share of the travel meanwhile, 0.3 mm, on the least slope of a line."""
    events, track = waking(scan, MS), track_of(rolling(0.3), DURATION_S)
    less, _, engine = sweep(events, track)
    dead_time = engine._cutter.dead_time
    assert dead_time is not None
    assert dead_time.blind_m == pytest.approx(3e-4, rel=0.05)
    monkeypatch.setattr(refine, "_WAKES", 0.0)
    plain = sweep(events, track)[0]
    np.testing.assert_array_equal(points_of(less), points_of(plain))
    after, before = (np.concatenate([p.sigma for p in own]) for own in (less, plain))
    added = np.sqrt(after**2 - before**2)
    # Where no lines are near, sigma is of the neighbourhoods' own and larger.
    assert (added > 0).sum() > 500
    np.testing.assert_allclose(added[added > 0], 0.15 * 3e-4 * 0.6, rtol=0.05)
