"""Gauges of edge drift from made-up lines whose drift is known."""

from dataclasses import replace

import numpy as np
import pytest

from roller_calibration import gauge as calibration
from roller_calibration import sphere_gauges as sphere_module
from roller_calibration.gauge import Gauge
from roller_calibration.pass_lines import PassLines
from roller_calibration.recordings import Scan
from roller_calibration.sphere_gauges import sphere_gauges
from roller_calibration.step_gauges import steps_gauges
from roller_core.camera import Camera
from roller_core.events import EventArray
from roller_core.pose_track import PoseTrack
from roller_emvs.lines.line_points import LinePoints
from roller_emvs.methods.surface import SurfaceSettings

STEP_M, RADIUS_M = 2e-4, 4e-3
SCAN = Scan("scan", EventArray.empty(), Camera(64, 48, 100.0, 100.0, 31.5, 23.5), PoseTrack())
SETTINGS = SurfaceSettings.create({})


def drift_m(polarity: np.ndarray, slope: np.ndarray) -> np.ndarray:
    """OFF edges drift, ON edges don't."""
    return np.where(polarity == 0, 90e-6, 0.0) * np.tanh(slope / 0.15)


#: How much denser events get along the crossing, as under light that travels.
LEAN = 3.0


def lines_of(rng: np.random.Generator, slope: np.ndarray, speed_m_s: float = 0.1) -> LinePoints:
    """Lines on slopes, of either polarity."""
    n = len(slope)
    none = np.zeros(n)
    polarity = rng.integers(0, 2, n)
    lean = LEAN * rng.choice([-1.0, 1.0], n)
    sigma, width = np.full(n, 1e-5), rng.uniform(1e-5, 3e-5, n)
    speed = np.full(n, speed_m_s)
    return LinePoints(none, none, none, polarity, slope, lean, none, none, sigma, width, speed)


def made_up_sphere(
    rng: np.random.Generator, drift: float = 1.0, speed_m_s: float = 0.1
) -> PassLines:
    """Lines all over a dome of 3 mm, and the cloud of points of it."""
    n = 1500
    rho, angle = 2.6e-3 * np.sqrt(rng.random(n)), rng.uniform(-np.pi, np.pi, n)
    x, y = rho * np.cos(angle), rho * np.sin(angle)
    z = np.sqrt(RADIUS_M**2 - rho**2)
    lines = lines_of(rng, -x / z, speed_m_s)
    cloud = np.column_stack([x, y, z]) + [0.05, 0.0, 0.0]
    height = z + drift * drift_m(lines.polarity, lines.slope) + rng.normal(0, 1e-5, n)
    return PassLines(np.column_stack([x + 0.05, y, height]), lines, cloud, np.eye(3), travel=LEAN)


def to_and_fro(rng: np.random.Generator, drift: float, speed_m_s: float = 0.1) -> list[PassLines]:
    """The same sphere rolled over both ways; each pass has its own axes."""
    passes = [made_up_sphere(rng, drift, speed_m_s) for _ in range(2)]
    # Back: x and y point the other way in base, the sphere lies where it was.
    back = np.diag([-1.0, -1.0, 1.0])
    moved = passes[1].place - [0.1, 0.0, 0.0]
    passes[1] = replace(passes[1], place=moved, cloud=passes[0].cloud, axes=back)
    return passes


def made_up_steps(
    rng: np.random.Generator,
    step_m: float = STEP_M,
    drift: float = 1.0,
    base_m: float = -0.002,
    higher_m: float = 0.0,
    speed_m_s: float = 0.1,
    climb_m: float = 0.0,
) -> PassLines:
    """Lines on walls that turn by a degree against the roll, five up and five down.

    OFF lines lie at their foot, ON lines at their top, those of falling walls over `climb_m` of
    height.
    """
    change = np.array([1.0] * 5 + [-1.0] * 5)
    wall = rng.integers(0, 10, 2000)
    slope = change[wall] * rng.uniform(0.5, 1.1, 2000)
    lines = lines_of(rng, slope, speed_m_s)
    y = rng.uniform(-6e-3, 6e-3, 2000)
    up = np.where(lines.polarity == 0, -0.4, 0.4)
    x = 0.03 + 1.1e-3 * wall + 1.5e-4 * up * change[wall] + np.radians(1.0) * y
    x += rng.normal(0, 1e-5, 2000)
    further = rng.uniform(-0.5, 0.5, 2000) * climb_m * ((lines.polarity == 1) & (slope < 0))
    x -= further
    height = step_m * ((np.cumsum(change) - 0.5 * change)[wall] + up) + base_m + higher_m + further
    height += drift * drift_m(lines.polarity, slope) + rng.normal(0, 1e-5, 2000)
    place = np.column_stack([x, y, height])
    return PassLines(place, lines, place, np.eye(3), travel=LEAN)


def gauges(
    monkeypatch: pytest.MonkeyPatch, drift: float = 1.0, speed_m_s: float = 0.1, seed: int = 0
) -> list[Gauge]:
    """Of a sphere, to and fro, and steps."""
    rng = np.random.default_rng(seed)
    steps = made_up_steps(rng, drift=drift, speed_m_s=speed_m_s)
    found = iter([to_and_fro(rng, drift, speed_m_s), [steps]])
    monkeypatch.setattr(calibration, "pass_lines", lambda *_: [next(found)])
    monkeypatch.setattr(sphere_module, "rolling_speed_m_s", lambda _: speed_m_s)
    return [
        *sphere_gauges(SCAN, SETTINGS, RADIUS_M),
        *steps_gauges(SCAN, SETTINGS, STEP_M),
    ]
