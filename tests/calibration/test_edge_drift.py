"""The drift of edges: from made-up lines, and what is refused."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calibration import made_up_gauges
from calibration.made_up_gauges import (
    RADIUS_M,
    SCAN,
    SETTINGS,
    STEP_M,
    drift_m,
    gauges,
    lines_of,
    made_up_sphere,
    made_up_steps,
)
from roller_bringup.cli import main
from roller_calibration import gauge as calibration
from roller_calibration.drift_lines import GaugeLines
from roller_calibration.drift_tables import residual_table
from roller_calibration.edge_drift import fit_drift, sure_slope
from roller_calibration.gauge import OtherGaugeError
from roller_calibration.gauges import all_gauges
from roller_calibration.pass_lines import EdgeDriftError, PassLines
from roller_calibration.sphere_gauges import sphere_gauges
from roller_calibration.step_gauges import steps_gauges
from roller_emvs.lines.edge_drift import edge_drift, held_change
from simulated_scans import Scans


@pytest.mark.parametrize("drift", [0.0, 1.0])
def test_a_known_drift_is_found_again(monkeypatch: pytest.MonkeyPatch, drift: float) -> None:
    found = fit_drift(gauges(monkeypatch, drift))
    slope = np.array([-0.9, -0.6, 0.6, 0.9])
    for polarity in (0, 1):
        height, sigma = edge_drift(found.settings, polarity, slope, np.zeros(4), np.zeros(4), 0.1)
        expected = drift * drift_m(np.full(4, polarity), slope)
        assert np.all(np.abs(height - expected) < np.minimum(2 * sigma, 4e-5))
        assert sigma.max() < 8e-5
    assert found.settings.max_slope == pytest.approx(1.09, abs=0.1)
    assert max(found.after_m) < 3e-5


def test_light_that_stands_still_has_no_drift(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where on a wall its events arise must not be taken for drift."""
    monkeypatch.setattr(made_up_gauges, "LEAN", 0.3)
    found = fit_drift(gauges(monkeypatch, 1.0))
    for polarity in (0, 1):
        slope = np.array([-0.8, 0.8])
        height, sigma = edge_drift(found.settings, polarity, slope, np.zeros(2), np.zeros(2), 0.1)
        assert np.abs(height).max() < 2e-6
        assert sigma.min() > 5e-6
    assert found.corrected == (False, False)


@pytest.mark.parametrize("kind", ["lines", "depths"])
@pytest.mark.parametrize("base_m", [0.0, 0.05])
def test_steps_alone_tell_drift_and_on_the_nominal_surface_its_mean(
    monkeypatch: pytest.MonkeyPatch, base_m: float, kind: str
) -> None:
    """What lifts all edges alike shows where the height of the steps' foot is known."""
    rng = np.random.default_rng(3)
    steps = made_up_steps(rng, base_m=base_m, higher_m=8e-5)
    # Too few lines, and depths of neighbourhoods in their place.
    few = replace(steps, lines=calibration.take(steps.lines, rng.random(2000) < 0.01))
    few = replace(few, place=steps.place[: len(few.lines.row)])
    passes = [[steps]] if kind == "lines" else [[few], [replace(steps, kind=kind)]]
    monkeypatch.setattr(calibration, "pass_lines", lambda *_: passes)
    found = fit_drift(steps_gauges(SCAN, SETTINGS, STEP_M))
    slope, none = np.array([-0.8, 0.8]), np.zeros(2)
    both = np.array([edge_drift(found.settings, k, slope, none, none, 0.1) for k in (0, 1)])
    expected = np.stack([drift_m(np.full(2, k), slope) for k in (0, 1)])
    if base_m == 0.0:
        expected += 8e-5
    assert np.all(np.abs(both[:, 0] - expected) < 3e-5)


def test_drift_that_turns_slopes_over_is_told_by_the_side_that_walls_face(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Steps' levels say which walls go up, where their slopes say the contrary."""
    rng = np.random.default_rng(5)
    steps = made_up_steps(rng, drift=3.0, base_m=0.0)
    own = steps.lines
    seen = replace(own, slope=-own.slope, side=np.sign(own.slope))
    steps = replace(steps, lines=seen)
    monkeypatch.setattr(calibration, "pass_lines", lambda *_: [[steps]])
    gauge = steps_gauges(SCAN, SETTINGS, STEP_M)[0]
    assert np.mean(gauge.rise == np.sign(-gauge.lines.slope)) > 0.99
    found = fit_drift([gauge])
    assert found.settings.coefficients_m[1] == pytest.approx(0.0, abs=1e-6)
    side = np.array([-1.0, 1.0])
    height, _ = edge_drift(found.settings, 0, -0.8 * side, np.zeros(2), side, 0.1)
    assert np.abs(height - 3.0 * drift_m(np.zeros(2), 0.8 * side)).max() < 6e-5


def test_one_gauge_of_steps_tells_what_lifts_its_walls_alike_and_by_their_side(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A sphere beside it, whose own level is free, asks for no more of it."""
    rng = np.random.default_rng(4)
    sphere, steps = made_up_sphere(rng, 0.0), made_up_steps(rng, drift=1.5, base_m=0.0)
    alike = np.where(steps.lines.polarity == 0, 8e-5, 0.0)
    lifted = [replace(steps, place=steps.place + alike[:, None] * [0, 0, 1])]
    monkeypatch.setattr(
        calibration, "pass_lines", lambda scan, _: [[sphere] if scan.name == "ball" else lifted]
    )
    ball = replace(SCAN, name="ball")
    found, _ = all_gauges([ball], [SCAN], SETTINGS, RADIUS_M, STEP_M)
    height, _ = edge_drift(
        fit_drift(found).settings, 0, np.array([-0.8, 0.8]), *np.zeros((2, 2)), 0.1
    )
    assert height.mean() > 4e-5


def test_a_few_strays_say_nothing_of_the_slopes_that_they_seem_to_have(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Lines of a wall that show hardly a slope, and lie a step off: no sigma of flat ground."""
    *spheres, steps = gauges(monkeypatch)
    stray = np.flatnonzero((steps.lines.polarity == 0) & (steps.lines.slope > 0))[:20]
    slope, error_m = steps.lines.slope.copy(), steps.error_m.copy()
    slope[stray], error_m[stray] = 0.1, error_m[stray] - STEP_M
    with_strays = replace(steps, lines=replace(steps.lines, slope=slope), error_m=error_m)
    found = fit_drift([*spheres, steps, with_strays]).settings
    assert max(found.residual_m[:2]) < 50e-6


def test_what_lines_climb_with_their_wall_is_no_drift(monkeypatch: pytest.MonkeyPatch) -> None:
    """ON lines all along the foot of falling walls lie as high as it is there."""
    steps = made_up_steps(np.random.default_rng(6), base_m=0.0, climb_m=1.5e-4)
    monkeypatch.setattr(calibration, "pass_lines", lambda *_: [[steps]])
    found = fit_drift(steps_gauges(SCAN, SETTINGS, STEP_M))
    off_rising, off_falling, on_rising, on_falling = np.reshape(found.settings.residual_m, (4, -1))
    assert on_falling.max() < 1.5 * max(map(np.max, (off_rising, off_falling, on_rising)))
    assert on_falling.max() < 3e-5


@pytest.mark.parametrize(("off", "widened"), [(1.0, 1.0), (2.4, 1.2), (40.0, 1.5)])
def test_tails_widen_what_is_left_and_strays_hardly_do(off: float, widened: float) -> None:
    """68 % of the lines lie within one deviation and 95 % within two, but for strays."""
    n, left_m = 2000, 6e-5
    rest = np.where(np.arange(n) % 10 == 0, off, 1.0) * left_m
    none, slope, yes = np.zeros(n), np.full(n, 0.5), np.ones(n, np.bool_)
    lines = GaugeLines(slope, none, none, none, none, none, none, rest, slope, yes, ~yes)
    table = residual_table(lines, rest, none, 1.0, 1e-3)
    np.testing.assert_allclose(table[0], widened * left_m)
    np.testing.assert_allclose(table[1:], 1e-3)


def test_how_fast_contrast_changes_on_the_gauges_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """Beyond it the drift of a line stays what it is there."""
    rng = np.random.default_rng(7)
    found = []
    for gauge in gauges(monkeypatch):
        change = rng.uniform(-1.0, 1.0, len(gauge.error_m)) * np.where(gauge.lines.polarity, 3, 2)
        found.append(replace(gauge, lines=replace(gauge.lines, change=change)))
    settings = fit_drift(found).settings
    assert settings.most_change == pytest.approx((2.0, 3.0), rel=0.05)
    change = np.array([-9.0, -3.5, 0.5, 3.5, 9.0])
    for polarity, most in enumerate(settings.most_change):
        held = held_change(settings, polarity, change)
        np.testing.assert_allclose(held, [-most, -most, 0.5, most, most])
    unknown = settings.changed({"most_change": (0.0, 0.0)})
    np.testing.assert_array_equal(held_change(unknown, 0, change), change)


def test_how_wide_the_bands_of_events_were_is_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    found = fit_drift(gauges(monkeypatch))
    for median, widest in np.array(found.settings.widths_m).reshape(4, 2):
        assert median == pytest.approx(2e-5, rel=0.1)
        assert widest == pytest.approx(3e-5, rel=0.05)


def test_drift_that_nothing_tells_is_uncertainty(monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither slope nor change shows which way a wall rises: no place on it is that far off."""
    steps = made_up_steps(np.random.default_rng(9), base_m=0.0)
    level = np.random.default_rng(10).normal(0.0, 0.02, len(steps.lines.slope))
    lines = replace(steps.lines, slope=level, lean=0.1 * steps.lines.lean)
    monkeypatch.setattr(
        calibration, "pass_lines", lambda *_: [[replace(steps, lines=lines, travel=0.3)]]
    )
    found = fit_drift(steps_gauges(SCAN, SETTINGS, STEP_M))
    assert found.corrected == (False, False)
    assert 7e-5 < found.after_m[0] < 1.1e-4  # 90 µm up on walls that rise, and down on others
    none = np.zeros(1)
    assert edge_drift(found.settings, 0, none, none, none, 0.1)[1][0] > 7e-5
    assert edge_drift(found.settings, 1, none, none, none, 0.1)[1][0] < 3e-5


def test_what_drift_turns_over_says_from_which_slope_on_none_is() -> None:
    """With the sign of the side that walls face which rise; least where drift turns none over."""
    rng, n = np.random.default_rng(3), 2000
    rise = rng.choice([-1.0, 1.0], n)
    none, yes = np.zeros(n), np.ones(n, np.bool_)

    def lines(slope: np.ndarray) -> GaugeLines:
        return GaugeLines(slope, none, -rise, none, none, none, none, none, rise, yes, ~yes)

    turned = np.where(rng.random(n) < 0.5, -rise * rng.uniform(0.0, 0.4, n), 0.9 * rise)
    assert sure_slope(lines(turned)) == pytest.approx(-0.38, abs=0.02)
    assert sure_slope(lines(0.9 * rise)) == -0.1


def test_a_sphere_that_drifts_further_than_walls_does_not_lift_them(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Nor is it left out because its shape is off."""
    rng = np.random.default_rng(8)
    sphere, steps = made_up_sphere(rng), made_up_steps(rng, base_m=0.0)
    further = np.where((sphere.lines.polarity == 0) & (sphere.lines.slope > 0.1), 3e-4, 0.0)
    cloud = sphere.cloud * [1.0, 1.0, 0.86]
    sphere = replace(sphere, place=sphere.place + further[:, None] * [0, 0, 1], cloud=cloud)
    monkeypatch.setattr(
        calibration, "pass_lines", lambda scan, _: [[sphere if scan.name == "ball" else steps]]
    )
    ball = replace(SCAN, name="ball")
    found, left_out = all_gauges([ball], [SCAN], SETTINGS, RADIUS_M, STEP_M)
    assert not left_out
    slope, none = np.array([-0.8, 0.8]), np.zeros(2)
    height, _ = edge_drift(fit_drift(found).settings, 0, slope, none, none, 0.1)
    assert np.abs(height.mean()) < 2e-5
    assert np.abs(height - drift_m(none, slope)).max() < 1.2e-4
    # Alone it would do harm: that is said.
    steps = replace(steps, lines=calibration.take(steps.lines, np.arange(2000) < 50))
    steps = replace(steps, place=steps.place[:50])
    with pytest.raises(EdgeDriftError, match="no steps in view"):
        all_gauges([ball], [SCAN], SETTINGS, RADIUS_M, STEP_M)


def test_steps_that_are_none_or_of_another_height_are_refused(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rng = np.random.default_rng(1)
    monkeypatch.setattr(calibration, "pass_lines", lambda *_: [[made_up_steps(rng, 3e-4)]])
    with pytest.raises(EdgeDriftError, match=r"fit steps of 0\.(29|30). mm, not 0\.2 mm"):
        steps_gauges(SCAN, SETTINGS, STEP_M)
    # Depths are taken where lines are too few, not where they say that the size is wrong.
    steps = made_up_steps(rng, 2.4e-4)
    depths = replace(steps, kind="depths")
    monkeypatch.setattr(calibration, "pass_lines", lambda *_: [[depths]])
    assert steps_gauges(SCAN, SETTINGS, STEP_M)
    monkeypatch.setattr(calibration, "pass_lines", lambda *_: [[steps], [depths]])
    with pytest.raises(EdgeDriftError, match=r"fit steps of 0\.2[34]. mm, not 0\.2 mm"):
        steps_gauges(SCAN, SETTINGS, STEP_M)
    monkeypatch.setattr(calibration, "pass_lines", lambda *_: [[made_up_steps(rng)]])
    with pytest.raises(OtherGaugeError, match=r"steps of 0\.2 mm (better than of 0\.4 mm|not)"):
        steps_gauges(SCAN, SETTINGS, 2 * STEP_M)
    monkeypatch.setattr(calibration, "pass_lines", lambda *_: [[made_up_sphere(rng)]])
    with pytest.raises(EdgeDriftError, match=r"not 8 mm|no sphere"):
        sphere_gauges(SCAN, SETTINGS, 8e-3)
    flat = lines_of(rng, np.full(500, 0.01))
    place = rng.uniform(0, 0.01, (500, 3))
    monkeypatch.setattr(
        calibration, "pass_lines", lambda *_: [[PassLines(place, flat, place, np.eye(3))]]
    )
    with pytest.raises(EdgeDriftError, match="no steps in view"):
        steps_gauges(SCAN, SETTINGS, STEP_M)


def test_a_size_that_is_a_tenth_off_is_pointed_out(monkeypatch: pytest.MonkeyPatch) -> None:
    """As drift may do it, it isn't refused; but a wrong size makes a wrong correction."""
    rng = np.random.default_rng(3)
    steps, ball = made_up_steps(rng, drift=0.0), made_up_sphere(rng, drift=0.0)
    monkeypatch.setattr(calibration, "pass_lines", lambda *_: [[steps]])
    assert "--step-mm" not in steps_gauges(SCAN, SETTINGS, STEP_M)[0].text
    text = steps_gauges(SCAN, SETTINGS, 0.9 * STEP_M)[0].text
    assert "(+11% against the 0.18 mm given; is --step-mm right?)" in text
    monkeypatch.setattr(calibration, "pass_lines", lambda *_: [[ball]])
    assert "--radius-mm" not in sphere_gauges(SCAN, SETTINGS, RADIUS_M)[0].text
    assert "is --radius-mm right?" in sphere_gauges(SCAN, SETTINGS, 0.9 * RADIUS_M)[0].text
    # Drift makes a right sphere seem as much smaller.
    text = sphere_gauges(SCAN, SETTINGS, 1.1 * RADIUS_M)[0].text
    assert "(-9% against the 4.4 mm given)" in text


def test_of_several_recordings_one_whose_size_drift_hides_is_left_out(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    rng = np.random.default_rng(2)
    heights = {"slow": STEP_M, "fast": 2 * STEP_M, "faster": 3 * STEP_M}
    monkeypatch.setattr(
        calibration, "pass_lines", lambda scan, _: [[made_up_steps(rng, heights[scan.name])]]
    )
    scans = [replace(SCAN, name=name) for name in heights]
    found, left_out = all_gauges([], scans, SETTINGS, RADIUS_M, STEP_M)
    assert [gauge.name for gauge in found] == ["slow"]
    assert [str(reason).partition(":")[0] for reason in left_out] == ["fast", "faster"]
    # None fits: then it is the stated size that is wrong.
    with pytest.raises(calibration.OtherGaugeError, match=r"not 0\.2 mm; check --step-mm"):
        all_gauges([], scans[1:], SETTINGS, RADIUS_M, STEP_M)


def test_gauges_of_the_virtual_cell_correct_another_object(scans: Scans, tmp_path: Path) -> None:
    """By the command and replays alone: the report says so, and another object errs less."""
    small = {"camera": {"height": 180}, "scene": {"step_mm": 0.05, "width_mm": 9.0}}
    sphere = scans.bag("gauge_sphere", speed=0.5, **small, motion={"reverse": True})
    steps = scans.bag("gauge_steps", speed=0.5, **small)
    delay, found = tmp_path / "delay.yaml", tmp_path / "found.yaml"
    delay.write_text("/**/surface:\n  ros__parameters:\n    event_delay_s: 0.00043\n")
    words = ["calibrate", "edge-drift", "--sphere", sphere, "--radius-mm", 5, "--steps", steps]
    words += ["--step-mm", 0.25, "--params", delay, "--output", found]
    assert main([str(word) for word in words]) == 0
    bag = scans.bag("bumps", speed=0.5, **small)
    near_um = {}
    for name, params in (("not calibrated", delay), ("calibrated", found)):
        out = tmp_path / name
        words = ["replay", bag, "--method", "surface", "--params", params, "--output", out]
        assert main([str(word) for word in [*words, "--no-braille", "--no-picture"]]) == 0
        report = json.loads((out / "report.json").read_text())
        assert report["edge_drift"] == name
        near_um[name] = report["truth"]["objects"]["bumps"]["near_edge_mae_um"]
    assert near_um["calibrated"] < 0.8 * near_um["not calibrated"]
