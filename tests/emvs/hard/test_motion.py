"""Motions that tell little or nothing of depth."""

import numpy as np
import pytest

from emvs.hard import world
from emvs.hard.world import ALL, METHODS, SPEED_M_S, UPRIGHT, pending
from emvs.scenes import MS, Motion, rolling, turning
from roller_core.events import EventArray
from roller_core.transforms import F64


def along_axis(t: float) -> tuple[F64, F64]:
    return np.array([0.0, 0.0, -0.05 * t]), UPRIGHT


def wiggling(t: float) -> tuple[F64, F64]:
    """0.2 mm there and back, 30 times a second: at most 0.3 px of parallax over the range."""
    return np.array([1e-4 * np.sin(2 * np.pi * 30 * t), 0.0, 0.0]), UPRIGHT


def flicker(duration_s: float = world.DURATION_S) -> EventArray:
    """What a resting camera sees of a flickering light: the same edges again and again."""
    rng = np.random.default_rng(1)
    n = round(600_000 * duration_s)
    t = np.sort(rng.integers(0, int(duration_s * 1e9), n))
    x = rng.choice(np.arange(9, world.CAMERA.width, 23), n)
    return EventArray.from_arrays(x, rng.integers(0, world.CAMERA.height, n), t, np.ones(n))


def dense(events: EventArray, times: int) -> EventArray:
    """Strong edges: each event several times."""
    return events[np.repeat(np.arange(len(events)), times)]


MOTIONS = {
    "standstill": rolling(0.0),
    "pure rotation": turning(1.0),
    "along the optical axis": along_axis,
    "there and back": wiggling,
}


@pytest.fixture(scope="module")
def seen() -> dict[str, EventArray]:
    lines = world.line_positions(pitch_m=0.002)
    return {
        name: flicker()
        if name == "standstill"
        else dense(world.scan(motion, lines=lines, step_s=2e-4), 20)
        for name, motion in MOTIONS.items()
    }


@pytest.mark.parametrize("name", MOTIONS)
@pytest.mark.parametrize("method", METHODS)
def test_no_parallax_no_depth_in_windows_by_time(
    seen: dict[str, EventArray], method: str, name: str
) -> None:
    found = world.run(method, seen[name], world.poses(MOTIONS[name]), window={"rule": "time"})
    assert not len(world.points_of(found))
    # The last window may be refused for being short.
    assert all("parallax" in r.reason for r in world.refused_of(found)[:2])


@pytest.mark.parametrize("name", MOTIONS)
@pytest.mark.parametrize("method", ALL)
def test_no_parallax_no_depth_by_travel(
    seen: dict[str, EventArray], method: str, name: str
) -> None:
    values = {} if method == "surface" else {"window": {"rule": "travel"}}
    found = world.run(method, seen[name], world.poses(MOTIONS[name]), max_still_s=0.05, **values)
    assert not len(world.points_of(found))
    assert "parallax" in world.refused_of(found)[0].reason


CRAWL_M_S = 0.001


@pytest.fixture(scope="module")
def crawl() -> EventArray:
    """The default scan at 1 mm/s: the same events, 300 times slower."""
    events = world.scan()
    return events.with_times(events.t_ns * round(SPEED_M_S / CRAWL_M_S))


def crawl_poses() -> world.PoseTrack:
    return world.poses(rolling(CRAWL_M_S), world.DURATION_S * SPEED_M_S / CRAWL_M_S)


@pytest.mark.parametrize("method", ALL)
def test_crawling_is_measured_where_it_may_take_long(crawl: EventArray, method: str) -> None:
    values = {"min_speed_m_s": 0.0} if method == "surface" else {"window": {"rule": "travel"}}
    found = world.run(method, crawl, crawl_poses(), max_still_s=30.0, **values)
    world.assert_right(world.points_of(found))


@pytest.mark.parametrize("method", METHODS)
def test_crawling_has_no_parallax_in_a_window_of_33_ms(crawl: EventArray, method: str) -> None:
    """33 µm of travel are 0.05 px over the range."""
    some = dense(crawl[crawl.t_ns < 700 * MS], 100)
    found = world.run(method, some, crawl_poses(), window={"rule": "time"})
    assert not len(world.points_of(found))


@pytest.mark.parametrize("method", ALL)
def test_crawling_is_refused_by_default(crawl: EventArray, method: str) -> None:
    """Windows by travel are given up after a second; the surface leaves out slow events."""
    values = {} if method == "surface" else {"window": {"rule": "travel"}}
    found = world.run(method, crawl, crawl_poses(), **values)
    assert not len(world.points_of(found))


def there_and_back(t: float) -> tuple[F64, F64]:
    """Turns round at 48 ms, about the middle of the second window by time.

    At a pose: between two, the straight path from one to the next would cut the corner.
    """
    return np.array([SPEED_M_S * min(t, 0.096 - t), 0.0, 0.0]), UPRIGHT


@pytest.mark.parametrize("window", ["time", "travel"])
@pytest.mark.parametrize("method", METHODS)
def test_a_reversal_in_a_window_leaves_the_depth_right(method: str, window: str) -> None:
    """What counts is how far the places that the window saw from lie apart: 5 mm at least.

    On the return a line enters a pixel from its other side, so the two paths differ by a pixel.
    Windows by travel end there.
    """
    events = world.scan(there_and_back, share=1.0)
    track = world.poses(there_and_back)
    found = world.run(method, events, track, window={"rule": window})
    middle = [f for f in world.maps_of(found) if f.start_ns < 48 * MS < f.end_ns]
    assert len(middle) == (window == "time")
    if not middle:
        middle = [f for f in world.maps_of(found) if 48 * MS in (f.start_ns, f.end_ns)]
        assert len(middle) == 2
    points = world.points_of(list(middle))
    world.assert_right(points, one_pixel_m=world.pixel_m(0.005), typical_px=1.0)


def test_a_reversal_parts_the_passes_of_the_surface() -> None:
    events = world.scan(there_and_back)
    found = world.run("surface", events, world.poses(there_and_back))
    world.assert_right(world.points_of(found), one_pixel_m=world.pixel_m(0.009))


def stop_and_go(t: float) -> tuple[F64, F64]:
    """Stands for 20 ms, so for most of the first window."""
    return np.array([SPEED_M_S * max(t - 0.02, 0.0), 0.0, 0.0]), UPRIGHT


@pytest.mark.parametrize(
    "method",
    pending(
        (*ALL, "left_right"), ("left_right",), "edges seen from one place alone pass for depth"
    ),
)
def test_a_window_that_stands_and_then_moves_gives_no_wrong_depth(method: str) -> None:
    """Edges that flickered at rest vote alike on all planes; only those that moved tell."""
    moving = world.scan(stop_and_go)
    events = EventArray.concatenate([flicker(0.02), moving]).sorted_by_time()
    found = world.run(method, events, world.poses(stop_and_go))
    # The first window travels 4 mm in windows by time.
    world.assert_right(world.points_of(found), one_pixel_m=world.pixel_m(0.004), at_least=50)


def noisy(events: EventArray, share: float) -> EventArray:
    rng = np.random.default_rng(2)
    n = int(share * len(events))
    t = rng.integers(0, int(events.t_ns[-1]), n)
    x, y = rng.integers(0, world.CAMERA.width, n), rng.integers(0, world.CAMERA.height, n)
    noise = EventArray.from_arrays(x, y, t, rng.integers(0, 2, n))
    return EventArray.concatenate([events, noise]).sorted_by_time()


@pytest.mark.parametrize("method", ALL)
def test_noise_does_not_pass_for_depth(method: str) -> None:
    """As many events of noise as of edges: depths stay right."""
    motion: Motion = rolling(SPEED_M_S)
    events = noisy(world.scan(motion), 1.0)
    world.assert_right(world.points_of(world.run(method, events, world.poses(motion))))


#: A robot's ramp, m/s², and by how much event stamps lag.
RAMP_M_S2, DELAY_S = 5.0, 0.0007


def speeding_up(t: float) -> tuple[F64, F64]:
    """From 0.1 m/s on."""
    return np.array([0.1 * t + 0.5 * RAMP_M_S2 * t**2, 0.0, 0.0]), UPRIGHT


@pytest.fixture(scope="module")
def ramp() -> EventArray:
    events = world.scan(speeding_up)
    return events.with_times(events.t_ns + round(DELAY_S * 1e9))


def ramp_error_m(method: str, ramp: EventArray, delay_s: float) -> tuple[float, float]:
    """Median error of depth, and what Z·a·delay/v says where the points lie, metres."""
    values: dict[str, object] = {} if method == "surface" else {"window": {"rule": "travel"}}
    found = world.run(method, ramp, world.poses(speeding_up), event_delay_s=delay_s, **values)
    points = world.points_of(found)
    points = points[points[:, 0] > 0.005]  # seen from 0.2 m/s on
    assert len(points) > 50
    speed = np.sqrt(0.1**2 + 2 * RAMP_M_S2 * np.clip(points[:, 0], 0.0, None))
    expected = np.median(points[:, 2] * RAMP_M_S2 * (DELAY_S - delay_s) / speed)
    return float(np.median(points[:, 2] - world.tilted(points[:, 0]))), float(expected)


@pytest.mark.parametrize("method", ALL)
def test_depth_in_a_ramp_is_right_where_the_delay_is_known(ramp: EventArray, method: str) -> None:
    found, expected = ramp_error_m(method, ramp, DELAY_S)
    assert expected == 0.0
    assert abs(found) < 0.5 * world.pixel_m()


@pytest.mark.parametrize("method", ALL)
def test_an_unknown_delay_scales_depth_in_a_ramp(ramp: EventArray, method: str) -> None:
    """As docs/hard_cases.md says: by acceleration × delay / speed."""
    found, expected = ramp_error_m(method, ramp, 0.0)
    assert expected > world.pixel_m()
    assert found == pytest.approx(expected, abs=0.5 * world.pixel_m())


def braking(t: float) -> tuple[F64, F64]:
    """From 0.3 m/s to rest at 15 m/s², a quarter into a step between poses."""
    s = min(max(t - 0.066, 0.0), SPEED_M_S / 15.0)
    return np.array([SPEED_M_S * (min(t, 0.066) + s) - 7.5 * s**2, 0.0, 0.0]), UPRIGHT


@pytest.mark.parametrize("method", ALL)
def test_the_end_of_a_scan_is_right_where_the_robot_brakes_hard(method: str) -> None:
    """There places are seen from one side alone, and a straight step errs by up to 120 µm."""
    found = world.run(method, world.scan(braking, share=1.0), world.poses(braking))
    points = world.points_of(found)
    end = points[points[:, 0] > 0.017]
    world.assert_right(end, typical_px=1.0 if method == "bma" else 0.5)
