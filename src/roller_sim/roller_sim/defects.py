"""Plates with labelled defects: sizes from ladders, places by a seed. Lengths in millimetres."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from .cell_settings import SceneSettings
from .plates import PLATE_PRESS, RIVET_RISE, new_plate, put_rivet
from .relief import F64, DefectMark, Plate, Scene

#: Distance of defects along and across the roll, how many lie side by side, and by how much a
#: place differs from its lattice point, at most.
PITCH, PITCH_ACROSS, ACROSS, SHIFT = 7.0, 6.5, 3, 0.3
#: Longest dent or piece, by its width.
LONGEST = 1.4
#: Scratches are so long, and this share of the width of other defects.
SCRATCH_LENGTH, SCRATCH_NARROWER = 4.0, 1 / 3
#: A crater's rim: its height by the depth, and its share of the half width.
RIM_HEIGHT, RIM_SHARE = 0.3, 1 / 3
RIVET_RADIUS, RIVET_GROOVE = 1.8, 0.3


def _bowl(u: F64, v: F64) -> F64:
    return np.maximum(1 - u**2 - v**2, 0.0)


def _crater(u: F64, v: F64) -> F64:
    inner = 1 - RIM_SHARE
    rim = 1 - ((np.hypot(u, v) - inner) / RIM_SHARE * 2 - 1) ** 2
    return RIM_HEIGHT * np.maximum(rim, 0.0) - _bowl(u / inner, v / inner)


def _block(u: F64, v: F64) -> F64:
    return ((np.abs(u) <= 1) & (np.abs(v) <= 1)).astype(np.float64)


def _groove(u: F64, v: F64) -> F64:
    return np.maximum(1 - np.abs(v), 0.0) * (np.abs(u) <= 1)


#: By kind: height over the plate for a depth of 1, at places along and across by the half size;
#: its sign as findings have it; whether its outline is an ellipse (else a rectangle).
SHAPES: dict[str, tuple[Callable[[F64, F64], F64], int, bool]] = {
    "dent": (lambda u, v: -_bowl(u, v), -1, True),
    "crater": (_crater, -1, True),
    "scratch": (lambda u, v: -_groove(u, v), -1, False),
    "raised": (_bowl, 1, True),
    "missing": (lambda u, v: -_block(u, v), -1, False),
    "extra": (_block, 1, False),
}


def defects(settings: SceneSettings) -> Scene:
    """Defects of the kinds, depths and widths set, each combination about as often.

    A rivet set askew is a `raised` place; one that is flush is an object without a mark. A
    crater's width and length include its rim.
    """
    plate = _plate(settings)
    rng = np.random.default_rng([settings.seed, 31])
    wanted = [
        (kind, depth, width)
        for kind in settings.defect_kinds
        for depth in settings.defect_depths_mm
        for width in settings.defect_widths_mm
    ]
    for i in range(settings.defects):
        if i % len(wanted) == 0:
            wanted = [wanted[k] for k in rng.permutation(len(wanted))]
        kind, depth, width = wanted[i % len(wanted)]
        shift = rng.uniform(-SHIFT, SHIFT, 2)
        x = settings.margin_mm + (i // ACROSS + 0.5) * PITCH + float(shift[0])
        y = (i % ACROSS - (ACROSS - 1) / 2) * PITCH_ACROSS + float(shift[1])
        length, angle = width * rng.uniform(1.0, LONGEST), rng.uniform(0.0, 180.0)
        if kind == "scratch":
            length, width = SCRATCH_LENGTH, width * SCRATCH_NARROWER
        elif kind == "crater":
            length = width = width / (1 - RIM_SHARE)
        name = f"{kind}_{i + 1}"
        if kind.startswith("rivet"):
            tilt = depth if kind == "rivet_bent" else 0.0
            put_rivet(plate, name, (x, y), RIVET_RADIUS, RIVET_GROOVE, tilt)
            if tilt:
                size = 2 * RIVET_RADIUS, 2 * RIVET_RADIUS
                _mark(plate, name, "raised", (x, y), size, RIVET_RISE + tilt, 0.0)
        else:
            put_defect(plate, name, kind, (x, y), (length, width), depth, angle)
    return plate.scene("defects", PLATE_PRESS)


def clean(settings: SceneSettings) -> Scene:
    """The same plate without any."""
    return _plate(settings).scene("clean", PLATE_PRESS)


def _plate(settings: SceneSettings) -> Plate:
    """An empty plate; its region `plate` is what is rolled over at full speed and view."""
    length = math.ceil(settings.defects / ACROSS) * PITCH
    length = max(length, settings.length_mm - 2 * settings.margin_mm)
    plate = new_plate(settings, length)
    half = min(PITCH_ACROSS * ACROSS, settings.width_mm) / 2
    x0 = settings.margin_mm
    plate.put("plate", (x0, x0 + length, -half, half), lambda x, y: 0.0)
    return plate


def put_defect(
    plate: Plate,
    name: str,
    kind: str,
    at: tuple[float, float],
    size: tuple[float, float],
    depth: float,
    angle_deg: float,
) -> None:
    """Put a defect of one of the `SHAPES` on a plate, with its mark; a size is length, width."""
    shape, sign, _ = SHAPES[kind]
    c, s = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))

    def height(x: F64, y: F64) -> F64:
        dx, dy = x - at[0], y - at[1]
        return depth * shape((dx * c + dy * s) / size[0] * 2, (dy * c - dx * s) / size[1] * 2)

    mark = _mark(plate, name, kind, at, size, sign * depth, angle_deg)
    (x0, y0), (x1, y1) = (f(mark.outline, axis=0) * 1e3 for f in (np.min, np.max))
    plate.put(name, (x0, x1, y0, y1), height, join="add")


def _mark(
    plate: Plate,
    name: str,
    kind: str,
    at: tuple[float, float],
    size: tuple[float, float],
    depth: float,
    angle_deg: float,
) -> DefectMark:
    """Put a mark of a defect on the plate; its outline goes once around."""
    if SHAPES[kind][2]:
        turns = np.linspace(0, 2 * np.pi, 24, endpoint=False)
        u, v = np.cos(turns), np.sin(turns)
    else:
        u, v = np.array([1.0, -1, -1, 1]), np.array([1.0, 1, -1, -1])
    c, s = math.cos(math.radians(angle_deg)), math.sin(math.radians(angle_deg))
    u, v = u * size[0] / 2, v * size[1] / 2
    outline = np.stack([at[0] + u * c - v * s, at[1] + u * s + v * c], axis=1) * 1e-3
    mark = DefectMark(
        name, kind, at[0] * 1e-3, at[1] * 1e-3, size[0] * 1e-3, size[1] * 1e-3, depth * 1e-3,
        angle_deg, tuple((x, y) for x, y in outline.tolist()),
    )  # fmt: skip
    plate.defects.append(mark)
    return mark
