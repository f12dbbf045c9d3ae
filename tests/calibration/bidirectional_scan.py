"""Scans of lines that go to and fro, with event stamps that are late by a known time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from emvs.scenes import CAMERA, track_of
from roller_calibration import Scan, central_events
from roller_core.events import EventArray

LEVEL = np.array([0.0, 0.0, 0.0, 1.0])
WAY_M, DEPTH_M = 0.02, 0.045
PIXEL_M = DEPTH_M / CAMERA.fx


@dataclass(frozen=True)
class Course:
    """To and fro over `WAY_M` along x: where at a time, and when at a place on the way there."""

    duration_s: float
    place_m: Callable[[float], float]
    time_s: Callable[[np.ndarray], np.ndarray]

    def motion(self, t: float) -> tuple[np.ndarray, np.ndarray]:
        return np.array([self.place_m(min(max(t, 0.0), self.duration_s)), 0.0, 0.0]), LEVEL


def there_and_back(speed_m_s: float) -> Course:
    turn_s = WAY_M / speed_m_s
    return Course(
        2 * turn_s, lambda t: WAY_M - speed_m_s * abs(t - turn_s), lambda x: x / speed_m_s
    )


def swinging(period_s: float) -> Course:
    rate, half = 2 * np.pi / period_s, WAY_M / 2
    return Course(
        period_s,
        lambda t: half * (1 - np.cos(rate * t)),
        lambda x: np.arccos(1 - x / half) / rate,
    )


def uneven(seed: int = 3) -> np.ndarray:
    """Places of lines across the way, metres."""
    return np.cumsum(np.random.default_rng(seed).uniform(0.0006, 0.0019, 60)) - 0.02


def scan_of(course: Course, delay_s: float, lines_m: np.ndarray | None = None) -> Scan:
    """Lines that pass a camera, an event as each enters a pixel, its stamp too late.

    What brightens a pixel on the way there darkens it on the way back.
    """
    lines_m = uneven() if lines_m is None else lines_m
    columns = np.arange(CAMERA.width)
    rows = np.arange(0, CAMERA.height, 3)
    found = []
    for way in (1, -1):
        # Going there the image moves to the left: pixels are entered from the right.
        edge = (columns + 0.5 * way - CAMERA.cx) * PIXEL_M
        x = lines_m[:, None] - edge[None, :]
        line, column = np.nonzero((x > 0) & (x < WAY_M))
        t = course.time_s(x[line, column])
        found.append(
            (t if way > 0 else course.duration_s - t, column, (line % 2 == 0) == (way > 0))
        )
    t, column, on = (np.concatenate(parts) for parts in zip(*found, strict=True))
    order = np.argsort(t, kind="stable")
    stamps = np.round((t[order] + delay_s) * 1e9).astype(np.int64)
    events = EventArray.from_arrays(
        np.repeat(column[order], len(rows)), np.tile(rows, len(t)),
        np.repeat(stamps, len(rows)), np.repeat(on[order], len(rows)),
    )  # fmt: skip
    return Scan(central_events(events, CAMERA), CAMERA, track_of(course.motion, course.duration_s))
