"""How well a reference lies on the scan."""

from __future__ import annotations

from dataclasses import dataclass

from roller_core.transforms import F64


@dataclass(frozen=True)
class Alignment:
    """How the reference was laid on the scan.

    Attributes
    ----------
    reference : str
        ``self``, ``nominal``, ``golden`` or ``cad``.
    correction : ndarray of float64, shape (4, 4)
        Motion of the reference from where the robot's pose puts it, in base; the identity where
        nothing was refined.
    refined : tuple of str
        Degrees of freedom that the geometry determined: of ``x y z rx ry rz`` in the map's frame.
    residual_m : float
        Root mean square of what is left on cells without findings (robust); NaN without cells.
    cells : int
        Measured cells that it rests on.
    """

    reference: str
    correction: F64
    refined: tuple[str, ...]
    residual_m: float
    cells: int
