"""Loading the kernels before the first events come: compiling takes seconds, once a machine."""

from __future__ import annotations

import numpy as np

from . import warp
from .dot_shape import medians
from .dots import Dots
from .lattice_search import find_lattice, find_turn
from .reader_settings import Spacing


def warm_up(spacing: Spacing) -> None:
    """Compile the kernels, or load them, before there is anything to be late for."""
    warp.warm_up()
    column, row = np.divmod(np.arange(6, dtype=np.float64), 3)
    dots = Dots(column * spacing.dot_pitch_m, row * spacing.dot_pitch_m, np.ones(6))
    medians(np.zeros((1, 1, 1), np.float32))
    find_lattice(dots, spacing, left_first=True, angle=find_turn(dots, spacing))
