"""Errors of lines as sums of what drift and the gauges themselves may do, solved robustly."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from roller_core.transforms import F64

#: Deviation from which on lines count less, m, in deviations, and rounds of that.
HUBER_M, _HUBER, _ROUNDS = 6e-5, 1.5, 20


@dataclass(frozen=True)
class DriftSystem:
    """Least squares with ridge and Huber's weights over n lines and m unknowns."""

    #: Terms of the drift of OFF events, of ON events, and of each gauge. Shape (n, m).
    design: F64
    #: Metres. Shape (n,).
    error: F64
    #: By how much a line counts. Shape (n,).
    share: F64
    #: What a line errs by, m. Shape (n,).
    noise: F64
    #: Unknowns that are a gauge's own drift. Shape (m,).
    own_level: npt.NDArray[np.bool_]
    #: Unknowns that are where on a step's wall edges arise. Shape (m,).
    on_wall: npt.NDArray[np.bool_]

    def solve(self, spreads: list[F64]) -> tuple[F64, F64, F64]:
        """Coefficients, what they leave over, and the normal matrix.

        Parameters
        ----------
        spreads : list of ndarray
            What the unknowns may be, metres; m values in all.
        """
        full = self.share / self.noise**2
        whole = (self.design * full[:, None]).T @ self.design
        whole += np.diag(1 / np.concatenate(spreads) ** 2)
        weight = np.ones(len(self.error))
        for _ in range(_ROUNDS):
            # Most lines count in full: what the others lack is taken off.
            far = weight < 1
            own = self.design[far]
            normal = whole - (own * (full * (1 - weight))[far, None]).T @ own
            beta = np.linalg.solve(normal, self.design.T @ (full * weight * self.error))
            rest = self.error - self.design @ beta
            weight = np.minimum(1.0, _HUBER * self.noise / np.maximum(np.abs(rest), 1e-9))
        return np.asarray(beta, np.float64), rest, normal

    def cost(self, spreads: list[F64]) -> float:
        """What `solve` makes least."""
        beta, rest, _ = self.solve(spreads)
        off = np.abs(rest) / self.noise
        lost = np.where(off < _HUBER, off**2, 2 * _HUBER * off - _HUBER**2)
        return float(self.share @ lost + np.sum((beta / np.concatenate(spreads)) ** 2))
