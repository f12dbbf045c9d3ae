"""What every reference gives."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
import numpy.typing as npt

from roller_core.errors import RollerError
from roller_core.transforms import F64
from roller_inspect.height_map.height_map import F32, Bools, HeightMap


class ReferenceError(RollerError):
    """A reference that can't be read or doesn't fit the scan."""


@dataclass(frozen=True)
class Alignment:
    """How the reference was laid on the scan."""

    #: ``self``, ``nominal``, ``golden`` or ``cad``.
    reference: str
    #: Motion of the reference from where the robot's pose puts it, in base; the identity where
    #: nothing was refined. Shape (4, 4).
    correction: F64
    #: Degrees of freedom that the geometry determined: of ``x y z rx ry rz`` in the map's frame.
    refined: tuple[str, ...]
    #: Root mean square of what is left on cells without findings (robust); NaN without cells.
    residual_m: float
    #: Measured cells that it rests on.
    cells: int
    #: Their middle in base, metres. Shape (3,).
    middle_m: F64 = field(default_factory=lambda: np.zeros(3))


@dataclass(frozen=True)
class Comparison:
    """A map against a reference."""

    #: Height less the reference's; NaN where either is unknown. Shape (ny, nx).
    deviation_m: F32
    #: Standard uncertainty of the reference itself, metres. Shape (ny, nx).
    sigma_m: F32
    #: How it was laid on the scan.
    alignment: Alignment
    #: Whether its height over the scan rests on the robot's pose alone.
    by_pose: bool = False
    #: Whether its uncertainty is that of walls, whose deviation smoothing carries beyond them.
    of_walls: bool = False


class Reference(Protocol):
    """What a map is compared with.

    Attributes
    ----------
    name : str
        ``self``, ``nominal``, ``golden`` or ``cad``.
    models_part : bool
        Whether it has the part's own features, so that deviations are missing or extra material.
    """

    name: str
    models_part: bool

    def compare(self, height_map: HeightMap, masked: Bools | None = None) -> Comparison:
        """Lay the reference on a map and compare.

        Parameters
        ----------
        height_map : HeightMap
            The map; unmeasured cells don't count.
        masked : ndarray of bool, shape (ny, nx), optional
            Cells that fits leave out: findings.

        Raises
        ------
        ReferenceError
            If the reference doesn't fit the map: far from it, or nothing to compare.
        """
        ...


def rms_robust(values: npt.NDArray[np.floating]) -> float:
    """Standard deviation by the median; NaN without values."""
    values = values[np.isfinite(values)]
    return float(1.4826 * np.median(np.abs(values))) if len(values) else float("nan")
