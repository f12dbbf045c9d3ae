"""How well a reference lies on the scan."""

from __future__ import annotations

from dataclasses import dataclass

from roller_core.transforms import F64


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
