"""Scans over rings of events with nothing else in them, and pipelines run over them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from braille.writing import to_masks
from roller_braille.cells import Cell
from roller_braille.pipeline import BraillePipeline
from roller_braille.reader_settings import BrailleSettings
from roller_core.camera import Camera
from roller_core.events import EventArray
from roller_core.pose_track import PoseTrack
from roller_core.transforms import matrix_to_quaternion

CAMERA = Camera(480, 440, 1066.0, 1066.0, 239.5, 219.5)
DEPTH_M = 0.0455
#: Camera looks down: its x is base x, its y is base -y.
DOWN = np.diag([1.0, -1.0, -1.0])
START_NS = 1_700_000_000_000_000_000
SETTINGS = BrailleSettings.create({})
SPACING = SETTINGS.spacing


@dataclass
class Plate:
    """Dots on a plate in base, metres; each may have only part of its ring.

    `dots` holds x, y, first and last angle of the ring (radians, from +x to +y), events.
    """

    dots: list[tuple[float, float, float, float, int]] = field(default_factory=list)

    def write(
        self, masks: Sequence[int], x0: float = 0.0, y0: float = 0.0, events: int = 400
    ) -> Plate:
        """Add cells from x0 on; y0 is their middle row."""
        for n, mask in enumerate(masks):
            for dot in range(6):
                if mask >> dot & 1:
                    x = x0 + n * SPACING.cell_pitch_m + dot // 3 * SPACING.dot_pitch_m
                    y = y0 + (1 - dot % 3) * SPACING.dot_pitch_m
                    self.dots.append((x, y, 0.0, 2 * np.pi, events))
        return self

    def text(self, text: str, **where: float) -> Plate:
        """Add a line of text."""
        return self.write(to_masks(text), **where)  # type: ignore[arg-type]


def roll_track(
    x: Iterable[float],
    seconds: Iterable[float],
    y: float = 0.0,
    rate_hz: float = 125.0,
    rotation: np.ndarray = DOWN,
) -> PoseTrack:
    """A camera over the plate that goes from x to x at times, linearly in between."""
    times = np.asarray(list(seconds), float)
    track = PoseTrack()
    q = matrix_to_quaternion(rotation)
    for t in np.arange(times[0], times[-1] + 1e-9, 1 / rate_hz):
        at = [float(np.interp(t, times, list(x))), y, DEPTH_M]
        track.append(START_NS + round(t * 1e9), at, q)
    return track


def scan(plate: Plate, track: PoseTrack, seed: int = 0, noise: int = 0, p: int = 0) -> EventArray:
    """Events of a plate's rings while the camera moves, each at a random time in view."""
    rng = np.random.default_rng(seed)
    t0, t1 = track.start_ns, track.end_ns
    xs, ys = [], []
    for x, y, a, b, count in plate.dots:
        angle = rng.uniform(a, b, count)
        radius = SPACING.dot_diameter_m / 2 + rng.normal(0.0, 5e-5, count)
        xs.append(x + radius * np.cos(angle))
        ys.append(y + radius * np.sin(angle))
    px, py = np.concatenate([*xs, []]), np.concatenate([*ys, []])
    # A moving point fires where it is seen: spread over the travel, not over the time.
    moves = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(track.positions[:, 0])))])
    travel = rng.uniform(0.0, max(moves[-1], 1e-9), (8, len(px)))
    clock = np.interp(travel, moves, (track.times_ns - t0).astype(float))
    t = t0 + clock.astype(np.int64)
    # Positions alone: the camera doesn't turn.
    at_x, at_y = (np.interp(t - t0, track.times_ns - t0, track.positions[:, k]) for k in (0, 1))
    u = CAMERA.cx + CAMERA.fx * (px - at_x) / DEPTH_M
    v = CAMERA.cy + CAMERA.fy * -(py - at_y) / DEPTH_M
    seen = (u >= 0) & (u < CAMERA.width - 1) & (v >= 0) & (v < CAMERA.height - 1)
    # Each point of a ring fires as often as it comes by, whatever the length of the scan.
    keep = seen & (rng.random(t.shape) < 1.0)
    noise_t = rng.integers(t0, t1, noise)
    u = np.concatenate([u[keep], rng.integers(0, CAMERA.width, noise)])
    v = np.concatenate([v[keep], rng.integers(0, CAMERA.height, noise)])
    t_all = np.concatenate([t[keep], noise_t])
    polarity = np.full(len(t_all), p)
    polarity[int(keep.sum()) :] = rng.integers(0, 2, noise)
    return EventArray.from_arrays(np.round(u), np.round(v), t_all, polarity).sorted_by_time()


def over(plate: Plate, speed: float = 0.3, back: bool = False, y: float = 0.0) -> PoseTrack:
    """A roll over all of a plate at a speed, along or against x, with a standstill before it."""
    x = [d[0] for d in plate.dots] or [0.0, 0.03]
    a, b = min(x) - 0.025, max(x) + 0.025
    a, b = (b, a) if back else (a, b)
    seconds = abs(b - a) / speed
    return roll_track([a, a, b, b], [0.0, 0.1, 0.1 + seconds, 0.2 + seconds], y)


def text_of(plate: Plate, track: PoseTrack | None = None, **how: int) -> list[str]:
    """Lines read from a roll over a plate; `how` is for `scan`."""
    track = over(plate) if track is None else track
    return read(scan(plate, track, **how), track)[1].text()


def read(
    events: EventArray,
    track: PoseTrack,
    chunks: int = 1,
    camera: Camera = CAMERA,
    **settings: object,
) -> tuple[list[Cell], BraillePipeline]:
    """Cells read from a scan whose events come in chunks."""
    pipeline = BraillePipeline(BrailleSettings.create(settings), camera, track)
    cells: list[Cell] = []
    edges = np.linspace(0, len(events), chunks + 1).astype(int)
    for a, b in pairwise(edges):
        pipeline.add_events(events[a:b])
        cells += pipeline.results()
    cells += pipeline.results(flush=True)
    return cells, pipeline
