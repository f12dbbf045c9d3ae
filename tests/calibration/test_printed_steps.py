"""Steps under a printed skin: walls from the profile of a cloud that covers the treads too."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from roller_calibration.acceptance import limits, promised, shortfalls
from roller_calibration.printed_steps import find_printed_steps
from roller_calibration.reached import on_steps
from roller_calibration.recordings import Scan
from roller_calibration.step_gauges import OtherGaugeError, steps_gauges
from roller_emvs.methods.surface import SurfaceSettings
from simulated_scans import Scans

TREAD_M, WALL_M, NOISE_M = 1.6e-3, 6e-4, 2.5e-5


def cloud(
    change: np.ndarray,
    step_m: float,
    turn_deg: float = 0.0,
    seed: int = 0,
    tread_m: float = TREAD_M,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Depths on steps 13 mm wide on a plate 22 mm wide, their sigma, and where walls are.

    The skin rounds off walls and swings over their tops; both ends of the pass scatter.
    """
    rng = np.random.default_rng(seed)
    at = 8e-3 + tread_m * np.arange(len(change))
    x = rng.uniform(-10e-3, at[-1] + 18e-3, 80_000)
    y = rng.uniform(-11e-3, 11e-3, len(x))
    turn = np.radians(turn_deg)
    off = ((x * np.cos(turn) + y * np.sin(turn))[:, None] - at) / WALL_M
    part = np.clip(off + 0.5, 0.0, 1.0) + 0.4 * off * np.exp(-((2.2 * off) ** 2))
    height = np.where(np.abs(y) < 6.5e-3, step_m * part @ change, 0.0)
    ends = (x < -6e-3) | (x > at[-1] + 14e-3)
    noise = np.where(ends, 2e-4, NOISE_M) * rng.normal(size=len(x))
    return np.column_stack([x, y, height + noise]), np.where(ends, 1e-4, 3e-5), at


@settings(max_examples=25)
@given(
    up=st.integers(2, 5), down=st.integers(0, 5), turn_deg=st.floats(-2.5, 2.5),
    seed=st.integers(0, 99), step_m=st.sampled_from([1.5e-4, 2.5e-4, 4e-4]),
)  # fmt: skip
def test_walls_and_height(up: int, down: int, turn_deg: float, seed: int, step_m: float) -> None:
    change = np.array([1.0] * up + [-1.0] * min(down, up))
    places, sigma_m, at = cloud(change, step_m, turn_deg, seed)
    found = find_printed_steps(places, sigma_m, step_m)
    assert found is not None
    assert found.change.tolist() == change.tolist()
    np.testing.assert_allclose(found.at_m, at, atol=1.5e-4)
    assert np.degrees(np.arctan2(found.turn[1], found.turn[0])) == pytest.approx(turn_deg, abs=0.5)
    assert found.step_m == pytest.approx(step_m, rel=0.04)
    # The plate beside the steps isn't theirs.
    assert -6.6e-3 < found.reach_m[0] < -5e-3
    assert 5e-3 < found.reach_m[1] < 6.6e-3


def test_a_wall_that_is_missing_is_counted() -> None:
    """Two steps at once between others: the treads say so."""
    change = np.array([1.0, 2.0, 1.0, -1.0, -1.0, -1.0, -1.0])
    places, sigma_m, _ = cloud(change, 2.5e-4)
    found = find_printed_steps(places, sigma_m, 2.5e-4)
    assert found is not None
    assert found.tread.tolist() == [0, 1, 3, 4, 3, 2, 1, 0]
    assert found.middle.tolist() == [0.5, 2, 3.5, 3.5, 2.5, 1.5, 0.5]
    assert found.step_m == pytest.approx(2.5e-4, rel=0.02)


@pytest.mark.parametrize("given", [0.5, 0.7, 1.4])
def test_the_height_is_measured_not_given(given: float) -> None:
    places, sigma_m, _ = cloud(np.array([1.0, 1.0, 1.0, -1.0, -1.0, -1.0]), 2.5e-4)
    found = find_printed_steps(places, sigma_m, given * 2.5e-4)
    assert found is not None
    assert found.step_m == pytest.approx(2.5e-4, rel=0.02)


def test_a_plate_has_no_walls() -> None:
    rng = np.random.default_rng(1)
    flat = rng.uniform(-0.02, 0.02, (50_000, 3)) * [1, 0.5, 0] + [0, 0, 1] * rng.normal(
        0, NOISE_M, (50_000, 1)
    )
    sigma_m = np.full(len(flat), 3e-5)
    found = find_printed_steps(flat, sigma_m, 2.5e-4)
    assert found is None or len(found.at_m) == 0
    scattered = np.column_stack([flat[:, :2], rng.normal(0, 1e-3, len(flat))])
    found = find_printed_steps(scattered, sigma_m, 2.5e-4)
    assert found is None or len(found.at_m) < 2
    assert find_printed_steps(flat[:3], sigma_m[:3], 2.5e-4) is None


def test_a_gauge_under_a_printed_skin(scans: Scans) -> None:
    """As lines told it, its steps were 112 µm off, and as many as 20 walls were counted of 8."""
    read = scans.scan(
        "gauge_steps", speed=0.5, camera={"height": 180}, light={"speckle": 0.08},
        scene={"step_mm": 0.05, "width_mm": 9.0},
    )  # fmt: skip
    scan = Scan("printed", read.events, read.camera, read.track)
    surface = SurfaceSettings.create({"event_delay_s": 4.3e-4})
    reached = on_steps(scan, surface, 2.5e-4)
    assert reached.printed
    assert reached.form_m < 1e-5
    assert reached.error_m < 3.5e-5
    assert reached.coverage > 0.95
    assert reached.within > 0.85
    promise = promised("steps", scan, "ring", reached.printed)
    assert promise.printed
    assert list(shortfalls("steps", reached, limits("steps", promise))) == []
    (gauge,) = steps_gauges(scan, surface, 2.5e-4)
    assert gauge.text.startswith("8 walls of 0.2")
    assert "depths on them" in gauge.text
    # Specks are all over walls: in both polarities, on those that rise and those that fall.
    counts = [
        np.sum((gauge.lines.polarity == p) & (gauge.rise == r)) for p in (0, 1) for r in (1, -1)
    ]
    assert min(counts) > 100
    assert all(0.4 < a / b < 2.5 for a, b in pairwise(counts))
    with pytest.raises(OtherGaugeError, match=r"8 walls fit steps of 0\.2\d+ mm, not 0\.4 mm"):
        steps_gauges(scan, surface, 4e-4)
