"""Steps in a cloud of points, by the walls that lines show."""

import numpy as np
import pytest

from calibration.made_up_gauges import SCAN, SETTINGS, STEP_M
from roller_calibration import reached
from roller_calibration.reached import GaugeError, on_steps
from roller_emvs.lines.line_points import LinePoints
from roller_emvs.methods.surface import SurfacePatch

TREAD_M, WALL_M, NOISE_M = 1.1e-3, 4.5e-4, 2e-5
#: Five steps up, four down, and where the first of them is.
CHANGE = np.array([1.0] * 5 + [-1.0] * 4)
AT_M = 0.02 + TREAD_M * np.arange(len(CHANGE))


def profile_m(x: np.ndarray) -> np.ndarray:
    """Height of steps whose walls the skin rounds off."""
    part = np.clip((x[:, None] - AT_M) / WALL_M + 0.5, 0.0, 1.0)
    return np.asarray(STEP_M * part @ CHANGE)


def lines_at(
    rng: np.random.Generator, wall: int, off_m: float, polarity: int, count: int
) -> np.ndarray:
    """Lines beside a wall's middle: place, polarity and slope, shape (count, 5)."""
    x = AT_M[wall] + off_m + rng.normal(0, 3e-5, count)
    y = rng.uniform(-4e-3, 4e-3, count)
    none = np.zeros(count)
    return np.column_stack([x, y, profile_m(x), none + polarity, none + 0.3 * CHANGE[wall]])


def made_up_pass(monkeypatch: pytest.MonkeyPatch, lines: np.ndarray, seed: int = 1) -> None:
    """A pass whose sweep gives these lines, and points all over the steps."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0.018, 0.031, 20000), rng.uniform(-4e-3, 4e-3, 20000)
    points = np.column_stack([x, y, profile_m(x) + rng.normal(0, NOISE_M, len(x))])
    n, none = len(lines), np.zeros(len(lines))
    every = LinePoints(
        none, none, none, lines[:, 3].astype(int), lines[:, 4], none, none, none,
        np.full(n, 3e-5), none, none + 0.25,
    )  # fmt: skip
    sigma = np.full(len(x), NOISE_M, np.float32)
    patch = SurfacePatch(points, sigma, sigma, sigma)
    axes = np.diag([1.0, 1.0, -1.0])
    monkeypatch.setattr(reached, "swept", lambda *_: ([patch], [(lines[:, :3], axes, every)]))


def test_a_polarity_far_from_the_other_is_no_wall_of_its_own(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As on the virtual cell: ON on the edge over the first wall that falls, and below others.

    Counted as a wall the first shifted all behind it, and those below moved walls by a third of a
    step's length: steps 25 µm off were said to be 122 µm off.
    """
    rng = np.random.default_rng(0)
    off = [(k, -5e-5, 0, 70 if k < 5 else 18) for k in range(9)]
    on = [
        (2, 4e-4, 1, 17),
        (3, 3e-4, 1, 17),
        (5, -5e-4, 1, 19),
        (6, 3.6e-4, 1, 37),
        (7, 3.4e-4, 1, 28),
    ]
    parts = [lines_at(rng, *row) for row in off + on]
    made_up_pass(monkeypatch, np.concatenate(parts))
    found = on_steps(SCAN, SETTINGS, STEP_M)
    assert found.form_m < 5e-6
    assert found.error_m < 3.5e-5
    assert found.coverage > 0.95


@pytest.mark.parametrize("polarity", [0, 1])
def test_one_polarity_is_enough(monkeypatch: pytest.MonkeyPatch, polarity: int) -> None:
    rng = np.random.default_rng(polarity)
    parts = [lines_at(rng, k, 0.0, polarity, 30) for k in range(9)]
    made_up_pass(monkeypatch, np.concatenate(parts))
    found = on_steps(SCAN, SETTINGS, STEP_M)
    assert found.form_m < 5e-6
    assert found.error_m < 3.5e-5


def test_lines_on_one_wall_are_no_steps(monkeypatch: pytest.MonkeyPatch) -> None:
    made_up_pass(monkeypatch, lines_at(np.random.default_rng(2), 3, 0.0, 0, 150))
    with pytest.raises(GaugeError, match="no walls of steps"):
        on_steps(SCAN, SETTINGS, STEP_M)
    made_up_pass(monkeypatch, lines_at(np.random.default_rng(2), 3, 0.0, 0, 90))
    with pytest.raises(GaugeError, match="no steps in view"):
        on_steps(SCAN, SETTINGS, STEP_M)
