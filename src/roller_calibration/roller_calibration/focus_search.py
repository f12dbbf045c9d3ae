"""Grid search over the parameters of `focus` that a sphere can tell.

Three: the neighbourhood (`focus.sigma_px`), the least confidence (`focus.min_confidence`) and the
drift of edges under the travelling light (`focus.edge_drift_m`). `focus` itself finds the sphere's
place, so a depth that is off by the same amount everywhere can't be told: unless the height of
the sphere's top is known, each choice is judged by its errors about their median.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from roller_core.camera import Camera
from roller_core.transforms import F64
from roller_emvs.depth_settings import DepthSettings
from roller_emvs.methods import focus
from roller_emvs.stopwatch import Stopwatch

from .contact import ContactWindow
from .error_table import I64

#: Names in `DepthSettings`, in the order of the grid.
NAMES = ("focus.sigma_px", "focus.min_confidence", "focus.edge_drift_m")


@dataclass(frozen=True)
class FocusGrid:
    """Choices that are tried, each with each.

    Attributes
    ----------
    sigmas_px, confidences, edge_drifts_m : tuple of float
        Values of `NAMES`.
    """

    sigmas_px: tuple[float, ...] = (3.0, 4.0, 5.0, 6.0, 8.0)
    confidences: tuple[float, ...] = (0.2, 0.3, 0.4, 0.5, 0.6)
    edge_drifts_m: tuple[float, ...] = (0.0, 1.25e-4, 2.5e-4, 3.75e-4, 5e-4)

    @property
    def shape(self) -> tuple[int, int, int]:
        """Number of values of each."""
        return len(self.sigmas_px), len(self.confidences), len(self.edge_drifts_m)

    @property
    def size(self) -> int:
        """Number of choices."""
        return int(np.prod(self.shape))

    def values(self, choice: int) -> dict[str, float]:
        """Parameters of a choice, by their names in `DepthSettings`."""
        at = np.unravel_index(choice, self.shape)
        ranges = (self.sigmas_px, self.confidences, self.edge_drifts_m)
        return {name: r[k] for name, r, k in zip(NAMES, ranges, at, strict=True)}

    def at_border(self, choice: int) -> list[str]:
        """Parameters of a choice that lie at an end of their range, by name."""
        at = np.unravel_index(choice, self.shape)
        return [
            name
            for name, k, n in zip(NAMES, at, self.shape, strict=True)
            if n > 2 and k in (0, n - 1)
        ]


def focus_errors(
    windows: Sequence[ContactWindow], camera: Camera, settings: DepthSettings, absolute: bool
) -> tuple[F64, I64]:
    """Errors of one choice over the contact circle of every window.

    Parameters
    ----------
    windows : sequence of ContactWindow
        Events, poses and the truth.
    camera : Camera
        Intrinsics.
    settings : DepthSettings
        Of the choice.
    absolute : bool
        Whether the truth's depth is known of its own; else errors count about their median.

    Returns
    -------
    errors_m : ndarray of float64, shape (windows,)
        Sums of absolute errors, metres.
    points : ndarray of int64, shape (windows,)
        Measured pixels.
    """
    found = []
    for window in windows:
        prepared, view = window.prepared, window.view
        depth, _ = focus.focus_depth(
            prepared.packets, camera, prepared.target, settings, Stopwatch()
        )
        miss = (view.box.of(depth) - view.depth_m)[view.mask]
        found.append(miss[np.isfinite(miss)])
    every = np.concatenate(found)
    offset = 0.0 if absolute or not len(every) else float(np.median(every))
    errors = np.array([np.abs(miss - offset).sum() for miss in found])
    return errors, np.array([len(miss) for miss in found], np.int64)
