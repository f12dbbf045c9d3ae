"""How far the edges of a polarity drift while they cross the image: an instrument's property.

Where light travels with the camera, a wall's contrast changes during its crossing, and with it the
place on its flank where a threshold is crossed. That looks like parallax: a line through such
events is off in height by the drift. What it is follows from the surface's slope along the roll,
from the speed, and from the width of the band in which the events lie; `roller calibrate
edge-drift` finds how.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from pydantic import Field, model_validator

from roller_core.settings import Settings
from roller_core.transforms import F64

from . import _drift_kernels as kernels

#: What a report says where no drift is known, and none is taken out.
NOT_CALIBRATED = "not calibrated"
#: And where it may be known, but the depth method has no use for it.
NOT_CORRECTED = "not corrected by the paper's methods"
#: Terms of the model: two that `coefficients_m` is of, one of `even_m` and one of `side_m`.
TERMS = 4
#: Slope at which the sign of a slope counts in full.
_TURN = 0.15
#: Slopes of the table of what a calibration leaves over: bins from 0 to the last, by polarity and
#: rising or falling.
SLOPE_BINS = 6
#: Beyond the calibrated slopes uncertainty grows by this share of the drift by unit of slope.
_BEYOND = 1.0
#: Share of a correction that stays uncertain: where on its walls a gauge's edges arise isn't known.
_DOUBT = 0.4


class EdgeDriftSettings(Settings):
    """Drift of edges by polarity; written by `roller calibrate edge-drift`."""

    coefficients_m: tuple[float, ...] = Field(
        (0.0,),  # ROS 2 has no empty lists in parameter files
        description="Of height by change of contrast and tanh(g / 0.15), g the slope along the "
        "roll: two of OFF, then two of ON events, m; a single 0: not calibrated.",
    )
    even_m: tuple[float, float] = Field(
        (0.0, 0.0),
        description="Of height by |tanh(g / 0.15)|: of OFF and of ON events, m.",
    )
    side_m: tuple[float, float] = Field(
        (0.0, 0.0),
        description="Of height by the side that a wall faces, as the change of contrast around "
        "tells it: of OFF and of ON events, m.",
    )
    sure_slope: float = Field(
        0.0,
        ge=-10.0,
        le=10.0,
        description="Slope from which on, in full from twice that, its sign tells the side that a "
        "wall faces; below 0 where a wall that rises faces the side -1. 0: the change of contrast "
        "alone tells it.",
    )
    by_speed_s: tuple[float, ...] = Field(
        (0.0,) * 2 * TERMS,
        description="By how much the coefficients change with speed: of OFF and then of ON events "
        "the two of `coefficients_m`, that of `even_m` and that of `side_m`, m per m/s.",
    )
    most_change: tuple[float, float] = Field(
        (0.0, 0.0),
        description="Fastest change of contrast calibrated, of OFF and of ON events; beyond it the "
        "drift of a line of `surface` stays what it is there. 0: not known.",
    )
    speeds_m_s: tuple[float, float, float] = Field(
        (0.0, 0.0, 0.0),
        description="Speed that the coefficients are of, slowest and fastest calibrated, m/s; "
        "0: not known.",
    )
    residual_m: tuple[float, ...] = Field(
        (0.0,),
        description="What is left by slope: six bins up to `max_slope`, of OFF rising, OFF "
        "falling, ON rising, ON falling, m; a single 0: not calibrated.",
    )
    max_slope: float = Field(0.0, ge=0.0, le=10.0, description="Steepest slope calibrated.")
    widths_m: tuple[float, ...] = Field(
        (0.0,) * 8,
        description="Width of the band in which a line's events lie, of OFF rising, OFF falling, "
        "ON rising, ON falling: median and widest calibrated of each, m; a 0: not known.",
    )

    @model_validator(mode="after")
    def _whole(self) -> EdgeDriftSettings:
        sizes = len(self.coefficients_m), len(self.residual_m)
        if sizes not in ((1, 1), (4, 4 * SLOPE_BINS)):
            raise ValueError(
                f"{sizes[0]} coefficients_m and {sizes[1]} residual_m: expected "
                f"4 and {4 * SLOPE_BINS}, or a single 0 in both"
            )
        if min(self.most_change) < 0:
            raise ValueError("most_change: expected two numbers of 0 or more")
        if len(self.widths_m) != 8:
            raise ValueError(f"{len(self.widths_m)} widths_m: expected 8")
        if len(self.by_speed_s) != 2 * TERMS:
            raise ValueError(f"{len(self.by_speed_s)} by_speed_s: expected {2 * TERMS}")
        at, slowest, fastest = self.speeds_m_s
        if any(self.speeds_m_s) and not 0 < slowest <= at <= fastest:
            raise ValueError(
                f"speeds_m_s {at:g}, {slowest:g}, {fastest:g}: expected one between the slowest "
                "and the fastest, then these two, all above 0, or three zeros"
            )
        if any(self.by_speed_s) and not any(self.speeds_m_s):
            raise ValueError("speeds_m_s must be above 0 where by_speed_s is not 0")
        if self.calibrated and not self.max_slope > 0:
            raise ValueError("max_slope must be above 0 where the drift is calibrated")
        return self

    @property
    def calibrated(self) -> bool:
        """Whether there is a calibration."""
        return len(self.coefficients_m) > 1

    @property
    def corrects(self) -> bool:
        """Whether it takes anything out, as where light travels with the camera."""
        return any(map(any, (self.coefficients_m, self.even_m, self.side_m, self.by_speed_s)))

    @property
    def sided(self) -> bool:
        """Whether drift depends on the side that a wall faces, at some speed."""
        return any(self.side_m) or any(self.by_speed_s[TERMS - 1 :: TERMS])

    def under_texture(self) -> EdgeDriftSettings:
        """Drift of what is printed on the skin: as its contrast tells, not the slope.

        The terms of slope say where on a wall's flank its own shading crosses a threshold. A
        printed speck lies where it is.
        """
        if not self.calibrated:
            return self
        off, _, on, _ = self.coefficients_m
        kept = {
            "coefficients_m": (off, 0.0, on, 0.0),
            "even_m": (0.0, 0.0),
            "by_speed_s": tuple(v * (k % TERMS in (0, 3)) for k, v in enumerate(self.by_speed_s)),
        }
        return self.changed(kept)

    def __str__(self) -> str:
        return "calibrated" if self.calibrated else NOT_CALIBRATED


def facing(
    side: npt.NDArray[np.floating], slope: F64, sure_slope: float
) -> npt.NDArray[np.floating]:
    """The side that walls face, by the change of contrast, and by the slope of those it tells.

    Drift may turn the slope of a low wall over, but not that of a steep one; and the change of
    contrast tells nothing where each pixel has few events of a wall.

    Parameters
    ----------
    side : ndarray
        -1 to 1, see `wall_side`.
    slope : ndarray of float64
        Of the surface along the roll, dh/dx; same shape.
    sure_slope : float
        See `EdgeDriftSettings`.
    """
    if not sure_slope:
        return side
    by_slope = np.clip(np.abs(slope / sure_slope) - 1.0, 0.0, 1.0)
    return side + by_slope * (np.sign(slope / sure_slope) - side)


def held_change(settings: EdgeDriftSettings, polarity: int, change: F64) -> F64:
    """Change of contrast of lines, held to what was calibrated.

    No edge drifts beyond its flank, however fast its contrast changes: drift saturates.
    """
    most = settings.most_change[polarity]
    return np.clip(change, -most, most) if most else change


def drift_terms(
    slope: F64, change: npt.NDArray[np.floating], side: npt.NDArray[np.floating]
) -> F64:
    """The model's terms, shape (..., 4): height by coefficient.

    Parameters
    ----------
    slope : ndarray of float64
        Of the surface along the roll, dh/dx.
    change : ndarray
        Of contrast during the crossing, see `crossing_change`; same shape.
    side : ndarray
        -1 to 1, see `facing`; same shape.
    """
    turned = np.tanh(slope / _TURN)
    return np.stack([change, turned, np.abs(turned), side], axis=-1)


def edge_drift(
    settings: EdgeDriftSettings,
    polarity: int,
    slope: F64,
    change: npt.NDArray[np.floating],
    side: npt.NDArray[np.floating],
    speed_m_s: F64 | float,
) -> tuple[F64, F64]:
    """Height by which edges are found too high, and its uncertainty, metres; see `drift_terms`.

    Beyond the calibrated slopes and speeds the drift stays what it is there. Its uncertainty grows
    by the larger of both times how far beyond that is: in slope, and in the speed's logarithm.
    `speed_m_s` is the camera's, one or of each edge; `side` is as of `wall_side`.
    """
    side = facing(side, slope, settings.sure_slope)
    beta, beyond = _coefficients(settings, polarity, speed_m_s)
    table = np.asarray(settings.residual_m).reshape(2, 2, SLOPE_BINS)[polarity]
    height, sigma = np.empty((2, len(slope)))
    kernels._drift(
        slope, change, side, beta, beyond, table, settings.max_slope, (_TURN, _DOUBT, _BEYOND),
        height, sigma,
    )  # fmt: skip
    return height, sigma


def _coefficients(
    settings: EdgeDriftSettings, polarity: int, speed_m_s: F64 | float
) -> tuple[F64, F64]:
    """Coefficients at a speed, shape (1, 4), or (n, 4) where they change with it.

    And how far that is beyond the calibrated speeds, by their logarithm, shape (1,) or (n,); 0
    where these aren't known.
    """
    beta = np.array(
        [
            *settings.coefficients_m[2 * polarity : 2 * polarity + 2],
            settings.even_m[polarity],
            settings.side_m[polarity],
        ]
    )
    at, slowest, fastest = settings.speeds_m_s
    if not at:
        return beta[None], np.zeros(1)
    speed = np.atleast_1d(np.asarray(speed_m_s, np.float64))
    held = np.clip(speed, slowest, fastest)
    by_speed = np.array(settings.by_speed_s).reshape(2, TERMS)[polarity]
    beta = beta + np.multiply.outer(held - at, by_speed) if by_speed.any() else beta[None]
    return beta, np.abs(np.log(np.maximum(speed, 1e-6) / held))


def drift_of_wider(
    settings: EdgeDriftSettings, polarity: int, slope: F64, width_m: F64, drift_m: F64
) -> F64:
    """Uncertainty of the drift of lines wider than any calibrated, metres; 0 for others.

    What light changes and what pixels' thresholds differ by both take an edge the further, the less
    its flank bends: drift goes with the width of the band in which the events lie.
    """
    known = np.asarray(settings.widths_m).reshape(2, 2, 2)[polarity, (slope < 0).astype(int)]
    median, widest = known[..., 0], known[..., 1]
    beyond = (widest > 0) & (width_m > widest)
    times = width_m / np.where(beyond, median, 1.0) - 1.0
    return np.where(beyond, times * drift_m, 0.0)
