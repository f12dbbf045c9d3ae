"""Height maps of plates, and the regions of the objects on them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt

from . import _relief_kernels as kernels
from .errors import SceneError

F32 = npt.NDArray[np.float32]
F64 = npt.NDArray[np.float64]
HeightFunction = Callable[[F64, F64], npt.ArrayLike]


@dataclass(frozen=True)
class Region:
    """The rectangle an object takes up on the plate, metres."""

    name: str
    x0: float
    x1: float
    y0: float
    y1: float

    def contains(self, x: npt.ArrayLike, y: npt.ArrayLike) -> npt.NDArray[np.bool_]:
        """Whether points (metres) lie in the region."""
        px, py = np.asarray(x), np.asarray(y)
        return (px >= self.x0) & (px <= self.x1) & (py >= self.y0) & (py <= self.y1)


@dataclass(frozen=True)
class BrailleMark:
    """One Braille cell on the plate: centre of its six dots (metres), mask and print character."""

    x: float
    y: float
    mask: int
    character: str
    line: int
    column: int


@dataclass(frozen=True)
class DefectMark:
    """A defect on the plate, metres."""

    #: Its name; `dent`, `crater`, `scratch`, `raised`, `missing` or `extra`, as findings have it.
    name: str
    kind: str
    #: Centre.
    x: float
    y: float
    #: Along its longer side and across.
    length: float
    width: float
    #: Of the relief, signed: + extra, − missing.
    depth: float
    #: Of its length against x.
    angle_deg: float
    #: Corners of its footprint.
    outline: tuple[tuple[float, float], ...]
    #: Depth as the skin follows it: its extreme within the footprint.
    skin_depth: float = 0.0

    def followed(self, skin: HeightMap) -> DefectMark:
        """The same with the depth to which a skin follows it."""
        (x0, y0), (x1, y1) = (f(self.outline, axis=0) for f in (np.min, np.max))
        columns = slice(*np.searchsorted(skin.x, [x0, x1]))
        part = skin.height[slice(*np.searchsorted(skin.y, [y0, y1])), columns]
        # Beside a narrow plate there is no skin to follow.
        deepest = part.max(initial=0.0) if self.depth > 0 else part.min(initial=0.0)
        return replace(self, skin_depth=float(deepest))


@dataclass(frozen=True)
class HeightMap:
    """Heights on a regular grid."""

    #: Metres over the plate's flat face; rows along y, columns along x. Shape (ny, nx).
    height: F32
    #: Position of ``height[0, 0]``, metres.
    x0: float
    y0: float
    #: Distance of grid points, metres.
    step: float

    @property
    def x(self) -> F64:
        """Positions of the columns, metres, shape (nx,)."""
        return np.asarray(self.x0 + self.step * np.arange(self.height.shape[1]), np.float64)

    @property
    def y(self) -> F64:
        """Positions of the rows, metres, shape (ny,)."""
        return np.asarray(self.y0 + self.step * np.arange(self.height.shape[0]), np.float64)

    @property
    def bounds(self) -> tuple[float, float, float, float]:
        """x0, x1, y0, y1 in metres."""
        return (self.x0, float(self.x[-1]), self.y0, float(self.y[-1]))

    def sample(self, x: npt.ArrayLike, y: npt.ArrayLike) -> F64:
        """Heights at points by bilinear interpolation; beyond the grid its border goes on.

        Parameters
        ----------
        x, y : array_like
            Metres, any shapes that broadcast.

        Returns
        -------
        ndarray of float64
            Metres.
        """
        x, y = np.broadcast_arrays(np.asarray(x, np.float64), np.asarray(y, np.float64))
        found = np.empty(x.shape)
        kernels._sample(
            self.height, x.ravel(), y.ravel(), self.x0, self.y0, self.step, found.reshape(-1)
        )
        return found

    def padded(self, x0: float, x1: float, y0: float, y1: float) -> HeightMap:
        """The map made larger with flat plate so that it covers a rectangle (metres)."""
        ny, nx = self.height.shape
        left = max(int(np.ceil((self.x0 - x0) / self.step - 1e-9)), 0)
        right = max(int(np.ceil((x1 - self.x[-1]) / self.step - 1e-9)), 0)
        low = max(int(np.ceil((self.y0 - y0) / self.step - 1e-9)), 0)
        high = max(int(np.ceil((y1 - self.y[-1]) / self.step - 1e-9)), 0)
        out = np.zeros((ny + low + high, nx + left + right), np.float32)
        out[low : low + ny, left : left + nx] = self.height
        return HeightMap(out, self.x0 - left * self.step, self.y0 - low * self.step, self.step)


@dataclass(frozen=True)
class Scene:
    """A plate to roll over."""

    #: Name the scene was asked for by.
    name: str
    #: The bare surface.
    relief: HeightMap
    #: Depth the roller is pressed below the plate's face at full contact.
    press_mm: float
    #: Objects on the plate, in order along the roll.
    regions: tuple[Region, ...] = ()
    #: What the Braille on the plate says, lines separated by newlines; empty without Braille.
    text: str = ""
    #: The Braille cells one by one.
    marks: tuple[BrailleMark, ...] = ()
    #: The defects one by one.
    defects: tuple[DefectMark, ...] = ()


@dataclass
class Plate:
    """A plate under construction; all lengths in millimetres, y = 0 is its middle line."""

    length: float
    width: float = 23.0
    step: float = 0.02
    regions: list[Region] = field(default_factory=list)
    marks: list[BrailleMark] = field(default_factory=list)
    defects: list[DefectMark] = field(default_factory=list)

    def __post_init__(self) -> None:
        if not (0 < self.step <= 0.2 and 1 <= self.length <= 2000 and 1 <= self.width <= 200):
            raise SceneError(
                f"plate of {self.length:g} × {self.width:g} mm at {self.step:g} mm a grid step: "
                "length may be 1–2000 mm, width 1–200 mm, step up to 0.2 mm"
            )
        self.x = np.arange(round(self.length / self.step) + 1) * self.step
        ny = round(self.width / 2 / self.step)
        self.y = np.arange(-ny, ny + 1) * self.step
        self.height = np.zeros((len(self.y), len(self.x)), np.float32)

    def put(
        self,
        name: str,
        bounds: tuple[float, float, float, float],
        function: HeightFunction,
        join: str = "max",
    ) -> None:
        """Shape a rectangle by a height function.

        Parameters
        ----------
        name : str
            The object's name; empty: no region of its own.
        bounds : tuple of float
            x0, x1, y0, y1, mm.
        function : callable
            Heights in mm at (x, y) in mm.
        join : str
            With what is there already: ``max``, ``min``, ``add`` or ``set``.
        """
        x0, x1, y0, y1 = bounds
        eps = self.step * 1e-6
        columns = slice(*np.searchsorted(self.x, [x0 - eps, x1 + eps]))
        rows = slice(*np.searchsorted(self.y, [y0 - eps, y1 + eps]))
        x, y = np.meshgrid(self.x[columns], self.y[rows])
        new = np.broadcast_to(np.asarray(function(x, y), np.float32), x.shape)
        part = self.height[rows, columns]
        if join == "set":
            part[:] = new
        else:
            part[:] = {"max": np.maximum, "min": np.minimum, "add": np.add}[join](part, new)
        if name:
            self.regions.append(Region(name, x0 * 1e-3, x1 * 1e-3, y0 * 1e-3, y1 * 1e-3))

    def scene(self, name: str, press_mm: float, text: str = "") -> Scene:
        """Close the construction."""
        relief = HeightMap(
            self.height * np.float32(1e-3), 0.0, float(self.y[0]) * 1e-3, self.step * 1e-3
        )
        return Scene(
            name, relief, press_mm, tuple(self.regions), text, tuple(self.marks),
            tuple(self.defects),
        )  # fmt: skip
