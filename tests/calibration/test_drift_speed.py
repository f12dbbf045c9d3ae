"""How drift goes with speed: from made-up gauges whose drift is known."""

from dataclasses import replace

import numpy as np
import pytest

from calibration.made_up_gauges import SCAN, SETTINGS, STEP_M, drift_m, gauges, made_up_steps
from roller_calibration import gauge as calibration
from roller_calibration.drift_speed import speed_text
from roller_calibration.edge_drift import fit_drift
from roller_calibration.gauge import Gauge
from roller_calibration.step_gauges import steps_gauges
from roller_emvs.lines.edge_drift import EdgeDriftSettings, edge_drift

SPEEDS = (0.1, 0.3, 0.5)
#: Per m/s, of what drift is at 0.3 m/s.
GROWS = 2.0


def of_speeds(
    monkeypatch: pytest.MonkeyPatch, grows: float, speeds: tuple[float, ...] = SPEEDS
) -> list[Gauge]:
    return [
        gauge
        for seed, speed in enumerate(speeds)
        for gauge in gauges(monkeypatch, 1.0 + grows * (speed - 0.3), speed, seed)
    ]


def height_m(settings: EdgeDriftSettings, polarity: int, speed_m_s: float) -> np.ndarray:
    """On a wall that falls, and on one that rises."""
    slope, none = np.array([-0.8, 0.8]), np.zeros(2)
    return edge_drift(settings, polarity, slope, none, none, speed_m_s)[0]


def test_drift_that_goes_with_speed_is_found(monkeypatch: pytest.MonkeyPatch) -> None:
    found = fit_drift(of_speeds(monkeypatch, GROWS)).settings
    assert found.speeds_m_s == (0.3, 0.1, 0.5)
    expected = np.zeros(8)
    expected[1] = GROWS * 90e-6
    np.testing.assert_allclose(found.by_speed_s, expected, atol=4e-5)
    pooled = found.changed({"by_speed_s": [0.0] * 8})
    slope = np.array([-0.8, 0.8])
    for speed in SPEEDS:
        true = (1.0 + GROWS * (speed - 0.3)) * drift_m(np.zeros(2), slope)
        assert np.abs(height_m(found, 0, speed) - true).max() < 2e-5
        assert np.abs(height_m(found, 1, speed)).max() < 1e-5
        if speed != 0.3:
            assert np.abs(height_m(pooled, 0, speed) - true).min() > 2e-5
    assert "OFF by slope +1" in speed_text(found)
    assert "ON" not in speed_text(found)


def test_drift_that_does_not_go_with_speed_has_no_term(monkeypatch: pytest.MonkeyPatch) -> None:
    """Though where on their walls events arise differs a little from pass to pass."""
    own = of_speeds(monkeypatch, 0.0)
    found = fit_drift(own).settings
    assert not any(found.by_speed_s)
    assert found.coefficients_m[1] == pytest.approx(90e-6, abs=3e-5)
    assert speed_text(found) == "drift by speed: no dependence on speed found, 0.1 to 0.5 m/s"


def test_light_that_stands_still_has_no_drift_by_speed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("calibration.made_up_gauges.LEAN", 0.3)
    found = fit_drift(of_speeds(monkeypatch, GROWS)).settings
    assert not any(found.by_speed_s)


@pytest.mark.parametrize("speeds", [(0.5,), (0.3, 0.35)])
def test_one_speed_tells_of_no_other(
    monkeypatch: pytest.MonkeyPatch, speeds: tuple[float, ...]
) -> None:
    """What is known is that speed: at others its drift is uncertain."""
    found = fit_drift(of_speeds(monkeypatch, GROWS, speeds)).settings
    assert not any(found.by_speed_s)
    assert found.speeds_m_s[1:] == (speeds[0], speeds[-1])
    assert speed_text(found).startswith("drift by speed: one speed, ")
    slope, none = np.array([-0.8, 0.8]), np.zeros(2)
    near, far = (edge_drift(found, 0, slope, none, none, v)[1] for v in (speeds[0], 0.1))
    assert (far > 1.2 * near).all()


def test_passes_over_walls_of_one_direction_tell_nothing_by_speed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of these the height of the whole pass, which isn't known, hides the drift."""
    own = of_speeds(monkeypatch, GROWS)
    for gauge in own:
        if not gauge.sphere and gauge.lines.speed_m_s[0] < 0.2:
            # OFF lines of this pass all fall.
            gauge.rise[gauge.lines.polarity == 0] = -1.0
    found = fit_drift(own).settings
    assert found.speeds_m_s == (0.4, 0.3, 0.5)


def test_what_lifts_all_walls_alike_goes_with_speed_too(monkeypatch: pytest.MonkeyPatch) -> None:
    """Light that darkens all walls once passed: each seems to rise, and lies as much too high."""
    own = []
    for seed, speed in enumerate(SPEEDS):
        higher_m = 1e-4 + 2e-4 * (speed - 0.3)
        rng = np.random.default_rng(seed)
        steps = made_up_steps(rng, drift=0.0, base_m=0.0, higher_m=higher_m, speed_m_s=speed)
        seen = replace(
            steps.lines, slope=np.abs(steps.lines.slope), side=np.full(len(steps.place), -1.0)
        )
        passes = [replace(steps, lines=seen)]
        monkeypatch.setattr(calibration, "pass_lines", lambda *_, passes=passes: [passes])
        own += steps_gauges(SCAN, SETTINGS, STEP_M)
    found = fit_drift(own).settings
    for speed in (0.1, 0.5):
        assert height_m(found, 0, speed)[1] == pytest.approx(1e-4 + 2e-4 * (speed - 0.3), abs=3e-5)
