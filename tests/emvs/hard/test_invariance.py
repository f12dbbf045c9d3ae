"""What must not change depth: where base is, how poses are written, how events are packed."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from emvs.hard import world
from emvs.hard.world import ALL, METHODS, SPEED_M_S, UPRIGHT
from emvs.scenes import MS, Motion, rolling
from roller_core.events import EventArray
from roller_core.pose_track import PoseTrack
from roller_core.transforms import (
    F64,
    multiply_quaternions,
    quaternion_to_matrix,
    rotation_vector_to_quaternion,
)
from roller_emvs.depth_map import DepthMap
from roller_emvs.methods.surface import SurfacePatch, SurfaceSweep
from roller_emvs.pipeline import DepthPipeline
from roller_emvs.windows import RefusedWindow

EPOCH_NS = 1_790_000_000_123_456_789
#: A fiftieth of a pixel of parallax.
TOLERANCE_M = 0.02 * world.pixel_m()
few = settings(
    max_examples=3,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)


@pytest.fixture(scope="module")
def events() -> EventArray:
    return world.scan()


def tilting(t: float) -> tuple[F64, F64]:
    """Rolling while the sensor tilts about the roll's direction by half a degree."""
    return np.array([SPEED_M_S * t, 0.0, 0.0]), rotation_vector_to_quaternion([0.1 * t, 0, 0])


@pytest.fixture(scope="module")
def tilting_events() -> EventArray:
    return world.scan(tilting, step_s=1.5e-4, share=0.8)


def assert_same_points(a: F64, b: F64, tolerance_m: float) -> None:
    """The same points but for a few.

    Rays are float32 from the reference view on, so a vote may fall to the other side of an edge of
    the image, and of two peaks of nearly one height the other may win.
    """
    assert len(a) > 50
    assert abs(len(a) - len(b)) <= 0.05 * len(a)
    assert np.mean(cKDTree(b).query(a)[0] > tolerance_m) < 0.05


@pytest.mark.parametrize("method", ALL)
@few
@given(
    far_m=st.tuples(*[st.floats(-1e4, 1e4)] * 3),
    turn=st.tuples(*[st.floats(-1.7, 1.7)] * 3),
    start_ns=st.sampled_from([0, EPOCH_NS]),
)
def test_base_may_be_anywhere(
    events: EventArray,
    method: str,
    far_m: tuple[float, float, float],
    turn: tuple[float, float, float],
    start_ns: int,
) -> None:
    """Another base, kilometres away and turned, and epoch time: the same depth.

    A float64 holds 10 km to 2 pm, a pixel is 56 µm; float32 would hold a millimetre.
    """
    q = rotation_vector_to_quaternion(turn)
    r = quaternion_to_matrix(q)

    def moved(t: float) -> tuple[F64, F64]:
        position, _ = rolling(SPEED_M_S)(t)
        return r @ position + np.array(far_m), multiply_quaternions(q, UPRIGHT)

    near = world.run(method, events, world.poses())
    far = world.run(method, events.shifted(start_ns), world.poses(moved, start_ns=start_ns))
    assert [type(f) for f in near] == [type(f) for f in far]
    for a, b in zip(world.maps_of(near), world.maps_of(far), strict=True):
        # A window by travel may end a nanosecond later: an event more or less.
        assert abs(b.start_ns - start_ns - a.start_ns) <= 2
        assert abs(b.events - a.events) <= 50
    back = (world.points_of(far) - np.array(far_m)) @ r
    assert_same_points(world.points_of(near), back, TOLERANCE_M)


def rewritten(track: PoseTrack, factors: F64) -> PoseTrack:
    out = PoseTrack()
    out.extend(track.times_ns, track.positions, track.quaternions * factors[:, None])
    return out


@pytest.mark.parametrize("method", ALL)
@settings(few, max_examples=2)
@given(seed=st.integers(0, 1000))
def test_quaternions_may_change_sign_and_length(
    tilting_events: EventArray, method: str, seed: int
) -> None:
    """q, -q and 1000·q are one rotation, also between neighbouring poses."""
    track = world.poses(tilting)
    rng = np.random.default_rng(seed)
    signs = rng.choice([-1.0, 1.0], len(track))
    lengths = signs * 10.0 ** rng.uniform(-3, 3, len(track))
    expected = world.points_of(world.run(method, tilting_events, track))
    # A change of sign changes no digit; a length rounds.
    flipped = world.points_of(world.run(method, tilting_events, rewritten(track, signs)))
    np.testing.assert_array_equal(flipped, expected)
    scaled = world.points_of(world.run(method, tilting_events, rewritten(track, lengths)))
    assert_same_points(expected, scaled, TOLERANCE_M)


def results_in_parts(
    method: str, events: EventArray, cuts: list[int], lag_ns: int
) -> Iterator[DepthMap | SurfacePatch | RefusedWindow]:
    full, track, k = world.poses(), PoseTrack(), 0
    engine: DepthPipeline | SurfaceSweep
    if method == "surface":
        engine = SurfaceSweep(world.SURFACE, world.CAMERA, track)
    else:
        chosen = world.DEPTH.changed({"method": method})
        engine = DepthPipeline(chosen, world.CAMERA, track)
    for a, b in pairwise([0, *sorted(set(cuts)), len(events)]):
        engine.add_events(events[a:b])
        while k < len(full) and full.times_ns[k] < events.t_ns[b - 1] - lag_ns:
            track.append(int(full.times_ns[k]), full.positions[k], full.quaternions[k])
            k += 1
        yield from engine.results()
    for j in range(k, len(full)):
        track.append(int(full.times_ns[j]), full.positions[j], full.quaternions[j])
    yield from engine.results(flush=True)


@pytest.mark.parametrize("method", ALL)
@few
@given(
    cuts=st.lists(st.integers(1, 90_000), min_size=1, max_size=40),
    lag_ms=st.sampled_from([-30, 0, 40]),
)
def test_packets_may_be_cut_anywhere(
    events: EventArray, method: str, cuts: list[int], lag_ms: int
) -> None:
    """The same events in other packets, poses early or late: the same results to the last digit."""
    whole = world.run(method, events, world.poses())
    cuts = [c for c in cuts if c < len(events)]
    parts = list(results_in_parts(method, events, cuts, lag_ms * MS))
    assert [type(p) for p in parts] == [type(w) for w in whole]
    np.testing.assert_array_equal(world.points_of(parts), world.points_of(whole))
    for a, b in zip(world.maps_of(whole), world.maps_of(parts), strict=True):
        np.testing.assert_array_equal(a.depth, b.depth)
        np.testing.assert_array_equal(a.confidence, b.confidence)


@pytest.mark.parametrize("method", METHODS)
@few
@given(factor=st.floats(0.3, 8.0))
def test_depth_scales_with_the_scene(events: EventArray, method: str, factor: float) -> None:
    """A scene and a motion of other size give the same events, and depths of that size."""

    def larger(t: float) -> tuple[F64, F64]:
        return factor * rolling(SPEED_M_S)(t)[0], UPRIGHT

    lengths = {"depth_min_m": 0.043, "depth_max_m": 0.047, "window.travel_m": world.WINDOW_M}
    values = {name: factor * length for name, length in lengths.items()}
    # As many planes in each; their number is rounded where it follows parallax.
    fixed = {"paper.plane_rule": "fixed"}
    expected = world.points_of(world.run(method, events, world.poses(), **fixed))
    found = world.run(method, events, world.poses(larger), **values, **fixed)
    assert_same_points(expected, world.points_of(found) / factor, TOLERANCE_M)


@few
@given(factor=st.floats(0.7, 4.0))
def test_depth_of_the_surface_scales_with_the_scene(events: EventArray, factor: float) -> None:
    """Its travel before a pass and margins of rows have a fixed size, so ends of passes differ."""
    motion: Motion = lambda t: (factor * rolling(SPEED_M_S)(t)[0], UPRIGHT)  # noqa: E731
    values = {
        name: factor * length
        for name, length in (
            ("depth_min_m", 0.043), ("depth_max_m", 0.047), ("min_aperture_m", 0.009),
            ("block_m", 0.008),
        )
    }  # fmt: skip
    found = world.points_of(world.run("surface", events, world.poses(motion), **values)) / factor
    world.assert_right(found, at_least=500)
