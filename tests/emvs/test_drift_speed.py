"""The drift of edges by speed: how `surface` and `focus` take it out."""

import numpy as np
import pytest

from emvs.scenes import CAMERA, rolling, tilted_scan, track_of
from roller_core.errors import SettingsError
from roller_core.transforms import F64
from roller_emvs.depth_settings import DepthSettings
from roller_emvs.lines.edge_drift import SLOPE_BINS, EdgeDriftSettings, edge_drift
from roller_emvs.lines.line_points import LinePoints
from roller_emvs.methods.focus import focus_depth
from roller_emvs.methods.surface import SurfacePatch, SurfaceSettings, SurfaceSweep
from roller_emvs.methods.surface.blocks import Block
from roller_emvs.methods.surface.strip import Strip
from roller_emvs.rays import make_packets
from roller_emvs.stopwatch import Stopwatch

OLD = {
    "coefficients_m": [-1e-4, 2e-5, 5e-5, -3e-5],
    "even_m": [2e-5, -3e-5],
    "side_m": [4e-5, -1e-5],
    "residual_m": np.linspace(1e-5, 4e-5, 4 * SLOPE_BINS).tolist(),
    "max_slope": 1.0,
}
#: Of OFF the change of contrast and the side, of ON what lifts all alike; µm per m/s.
BY_SPEED = [1e-4, 0.0, 0.0, -2e-4, 0.0, 0.0, 3e-4, 0.0]
NEW = {**OLD, "by_speed_s": BY_SPEED, "speeds_m_s": [0.3, 0.1, 0.5]}
#: NEW as it is at 0.4 m/s.
AT_04 = {
    **OLD,
    "coefficients_m": [-9e-5, 2e-5, 5e-5, -3e-5],
    "even_m": [2e-5, 0.0],
    "side_m": [2e-5, -1e-5],
}
SLOPE, CHANGE, SIDE = np.array(
    [[-1.5, -0.4, 0.0, 0.3, 0.9], [0.3, -0.2, 0.1, 0.0, -0.5], [0.5, 1.0, 0.0, -1.0, 0.2]]
)


def drift(values: dict[str, object], polarity: int, speed_m_s: F64 | float) -> tuple[F64, F64]:
    settings = EdgeDriftSettings.create(values)
    return edge_drift(settings, polarity, SLOPE, CHANGE, SIDE, speed_m_s)


@pytest.mark.parametrize("polarity", [0, 1])
def test_a_file_without_speeds_holds_at_any(polarity: int) -> None:
    """Whoever calibrated before has what was found."""
    settings = EdgeDriftSettings.create(OLD)
    beta = np.array([[-1e-4, 2e-5, 2e-5, 4e-5], [5e-5, -3e-5, -3e-5, -1e-5]])[polarity]
    turned = np.tanh(np.clip(SLOPE, -1.0, 1.0) / 0.15)
    expected = np.stack([CHANGE, turned, np.abs(turned), SIDE], axis=-1) @ beta
    sigmas = []
    for speed in (0.0, 0.05, 0.3, 3.0, np.linspace(0.0, 1.0, 5)):
        height, sigma = edge_drift(settings, polarity, SLOPE, CHANGE, SIDE, speed)
        np.testing.assert_allclose(height, expected, rtol=1e-13)
        sigmas.append(sigma)
    np.testing.assert_array_equal(sigmas, [sigmas[0]] * len(sigmas))


@pytest.mark.parametrize("polarity", [0, 1])
def test_coefficients_change_with_speed(polarity: int) -> None:
    for found, expected in zip(drift(NEW, polarity, 0.4), drift(AT_04, polarity, 0.4), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-18)
    np.testing.assert_array_equal(drift(NEW, polarity, 0.3), drift(OLD, polarity, 0.3))
    # Edges that each have a speed of their own.
    speeds = np.linspace(0.1, 0.5, len(SLOPE))
    each = np.array([drift(NEW, polarity, float(v)) for v in speeds])
    together = np.array(drift(NEW, polarity, speeds))
    np.testing.assert_allclose(together, np.diagonal(each, axis1=0, axis2=2), rtol=1e-12)


@pytest.mark.parametrize("values", [NEW, {**OLD, "speeds_m_s": [0.3, 0.1, 0.5]}])
@pytest.mark.parametrize(("end", "beyond"), [(0.1, 0.05), (0.5, 1.0)])
def test_beyond_the_calibrated_speeds_drift_is_held_and_less_sure(
    values: dict[str, object], end: float, beyond: float
) -> None:
    height, sigma = drift(values, 0, end)
    held, unsure = drift(values, 0, beyond)
    np.testing.assert_array_equal(held, height)
    over = np.log(2.0) * np.maximum(np.abs(height), sigma)
    np.testing.assert_allclose(unsure, np.hypot(sigma, over))
    assert (drift(values, 0, 0.0)[1] < 1.0).all()


def test_sides_count_where_they_do_at_some_speed() -> None:
    for by_speed, sided in ((BY_SPEED, True), ([1e-4] * 3 + [0.0] * 5, False)):
        own = EdgeDriftSettings.create({**NEW, "side_m": [0.0, 0.0], "by_speed_s": by_speed})
        assert own.sided is sided


def test_speeds_that_make_no_sense_are_refused() -> None:
    for change, text in (
        ({"by_speed_s": [0.0] * 4}, "4 by_speed_s: expected 8"),
        ({"speeds_m_s": [0.6, 0.1, 0.5]}, "between the slowest and the fastest"),
        ({"speeds_m_s": [0.3, 0.0, 0.5]}, "all above 0"),
        ({"speeds_m_s": [0.0] * 3}, "must be above 0 where by_speed_s is not 0"),
    ):
        with pytest.raises(SettingsError, match=text):
            EdgeDriftSettings.create({**NEW, **change})


def surface_m(values: dict[str, object]) -> F64:
    """Heights of `surface` on a tilted plane that is rolled over at 0.3 m/s."""
    settings = SurfaceSettings.create({"min_aperture_m": 0.013, "threads": 1, "edge_drift": values})
    sweep = SurfaceSweep(settings, CAMERA, track_of(rolling(0.3), 0.12))
    sweep.add_events(tilted_scan(0.12))
    found = [f for f in sweep.results(flush=True) if isinstance(f, SurfacePatch)]
    return np.concatenate([patch.points[:, 2] for patch in found])


def depth_m(values: dict[str, object]) -> F64:
    """A depth map of `focus` of the same."""
    settings = DepthSettings.create({"threads": 1, "edge_drift": values})
    events, track = tilted_scan(0.12), track_of(rolling(0.3), 0.12)
    table = CAMERA.undistortion_table()
    packets = make_packets(events[events.t_ns < 90_000_000], table, track, 500)
    view = track.matrices([45_000_000])[0]
    depth = focus_depth(packets, CAMERA, view, settings, Stopwatch())[0]
    return depth[np.isfinite(depth)].astype(np.float64)


@pytest.mark.parametrize("measure", [surface_m, depth_m])
def test_both_methods_take_out_the_drift_of_their_speed(measure) -> None:  # type: ignore[no-untyped-def]
    """The same at 0.3 m/s, said from another speed."""
    there = {
        **OLD,
        "coefficients_m": [-1.2e-4, 2e-5, 5e-5, -3e-5],
        "even_m": [2e-5, -9e-5],
        "side_m": [8e-5, -1e-5],
        "by_speed_s": BY_SPEED,
        "speeds_m_s": [0.1, 0.1, 0.5],
    }
    own, other = measure(OLD), measure(there)
    assert len(own) > 500
    np.testing.assert_allclose(other, own, atol=1e-6)
    # And without the term of speed it would be another.
    wrong = measure({**there, "by_speed_s": [0.0] * 8})
    assert np.abs(np.median(wrong) - np.median(own)) > 2e-6


def test_lines_know_their_speed() -> None:
    sweep = SurfaceSweep(
        SurfaceSettings.create({"threads": 1}), CAMERA, track_of(rolling(0.3), 0.12)
    )
    found: list[LinePoints] = []
    sweep.on_lines = lambda _place, _axes, lines: found.append(lines)
    sweep.add_events(tilted_scan(0.12))
    assert list(sweep.results(flush=True))
    speed = np.concatenate([lines.speed_m_s for lines in found])
    assert len(speed) > 100
    np.testing.assert_allclose(speed, 0.3, rtol=1e-6)


def test_the_speed_of_a_block_is_that_of_its_own_time_without_stops() -> None:
    """Of a pass at 0.1, then 0.3 m/s, with a stop of half a second between."""
    settings = SurfaceSettings.create({})
    pose = np.eye(4)
    rays = np.zeros((CAMERA.height, CAMERA.width, 2), np.float32)
    strip = Strip(settings, CAMERA, rays, 0, pose, np.array([1.0, 0.0, 0.0]))
    for t_ms in range(5, 905, 5):
        x = 0.1e-3 * min(t_ms, 200) + 0.3e-3 * max(t_ms - 700, 0)
        strip.advance(t_ms * 1_000_000, pose + np.pad([[x]], ((0, 3), (3, 0))))

    def speed(first_ms: int, last_ms: int) -> float:
        span = first_ms * 1_000_000, last_ms * 1_000_000
        return strip.speed_of(Block(0, 1, (0,), 0.0, 0.008, 0.0, 0.01, *span, 1))

    assert speed(50, 150) == pytest.approx(0.1)
    assert speed(750, 850) == pytest.approx(0.3)
    assert speed(100, 800) == pytest.approx(0.2)
    assert speed(300, 400) == 0.0
