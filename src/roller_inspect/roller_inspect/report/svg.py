"""Charts of a report as SVG, by hand: axes, lines, bars."""

from __future__ import annotations

import math
from collections.abc import Sequence
from html import escape

import numpy as np
import numpy.typing as npt

F64 = npt.NDArray[np.float64]
#: Room for the labels of axes, px: left, top, right, bottom.
_LEFT, _TOP, _RIGHT, _BOTTOM = 56, 10, 12, 36


class Chart:
    """Axes with what is drawn in them.

    Parameters
    ----------
    x, y : tuple of float
        Least and largest value of the axes.
    x_label, y_label : str
        With units.
    width, height : int
        Pixels.
    equal : bool
        Whether both axes have the same scale: the height then follows from the width.
    """

    def __init__(
        self,
        x: tuple[float, float],
        y: tuple[float, float],
        x_label: str,
        y_label: str,
        width: int = 520,
        height: int = 200,
        equal: bool = False,
    ) -> None:
        self._x, self._y = wide(x), wide(y)
        if equal:
            inner = width - _LEFT - _RIGHT
            span = self._y[1] - self._y[0]
            height = round(inner * span / (self._x[1] - self._x[0])) + _TOP + _BOTTOM
        self.width, self.height = width, height
        self._labels = (x_label, y_label)
        self._parts: list[str] = []

    def px(self, x: npt.ArrayLike) -> F64:
        """Horizontal place of values, px."""
        low, high = self._x
        inner = self.width - _LEFT - _RIGHT
        return np.asarray(_LEFT + (np.asarray(x, float) - low) / (high - low) * inner)

    def py(self, y: npt.ArrayLike) -> F64:
        """Vertical place of values, px."""
        low, high = self._y
        inner = self.height - _TOP - _BOTTOM
        return np.asarray(
            self.height - _BOTTOM - (np.asarray(y, float) - low) / (high - low) * inner
        )

    def image(self, uri: str) -> None:
        """A picture over all of the axes."""
        w, h = self.width - _LEFT - _RIGHT, self.height - _TOP - _BOTTOM
        self._parts.append(
            f'<image href="{uri}" x="{_LEFT}" y="{_TOP}" width="{w}" height="{h}" '
            'preserveAspectRatio="none"/>'
        )

    def band(self, low: float, high: float, along: str = "y") -> None:
        """An area between two values of an axis."""
        if along == "y":
            (x0, x1), (y1, y0) = self.px(self._x), self.py((low, high))
        else:
            (x0, x1), (y1, y0) = self.px((low, high)), self.py(self._y)
        self._parts.append(
            f'<rect class="band" x="{x0:.1f}" y="{y0:.1f}" width="{x1 - x0:.1f}" '
            f'height="{max(y1 - y0, 0):.1f}"/>'
        )

    def line(self, x: npt.ArrayLike, y: npt.ArrayLike, kind: str = "line") -> None:
        """A line, interrupted where a value is missing."""
        px, py = self.px(x), self.py(y)
        words, pen = [], "M"
        for a, b in zip(px.tolist(), py.tolist(), strict=True):
            if math.isfinite(a) and math.isfinite(b):
                words.append(f"{pen}{a:.1f} {b:.1f}")
                pen = "L"
            else:
                pen = "M"
        self._parts.append(f'<path class="{kind}" d="{" ".join(words)}"/>')

    def bars(self, edges: Sequence[float], counts: Sequence[float], kind: str = "bar") -> None:
        """Bars between edges."""
        px, (base, *tops) = self.px(edges), self.py([self._y[0], *counts])
        for x0, x1, top in zip(px[:-1], px[1:], tops, strict=True):
            if base - top > 0.05:
                self._parts.append(
                    f'<rect class="{kind}" x="{x0:.1f}" y="{top:.1f}" '
                    f'width="{max(x1 - x0 - 0.5, 0.5):.1f}" height="{base - top:.1f}"/>'
                )

    def outline(self, x: npt.ArrayLike, y: npt.ArrayLike, kind: str, label: str = "") -> None:
        """A closed outline with a label at its upper right."""
        px, py = self.px(x), self.py(y)
        points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(px, py, strict=True))
        self._parts.append(f'<polygon class="{kind}" points="{points}"/>')
        if label:
            at = min(float(px.max()) + 3, self.width - _RIGHT - 6 * len(label))
            up = max(float(py.min()) - 2, _TOP + 9)
            self._parts.append(
                f'<text class="tag" x="{at:.1f}" y="{up:.1f}">{escape(label)}</text>'
            )

    def __str__(self) -> str:
        w, h = self.width, self.height
        x0, y0, x1, y1 = _LEFT, _TOP, w - _RIGHT, h - _BOTTOM
        axes = [f'<rect class="frame" x="{x0}" y="{y0}" width="{x1 - x0}" height="{y1 - y0}"/>']
        for value in ticks(*self._x, max(2, (x1 - x0) // 70)):
            at = float(self.px(value))
            axes.append(f'<path class="tick" d="M{at:.1f} {y1}v4"/>')
            axes.append(f'<text class="mid" x="{at:.1f}" y="{y1 + 15}">{plain(value)}</text>')
        for value in ticks(*self._y, max(2, (y1 - y0) // 30)):
            at = float(self.py(value))
            axes.append(f'<path class="tick" d="M{x0} {at:.1f}h-4"/>')
            axes.append(f'<text class="end" x="{x0 - 7}" y="{at + 3.5:.1f}">{plain(value)}</text>')
        middle, (below, beside) = (y0 + y1) / 2, map(escape, self._labels)
        axes += [
            f'<text class="mid" x="{(x0 + x1) / 2:.0f}" y="{h - 5}">{below}</text>',
            f'<text class="mid" transform="rotate(-90 12 {middle:.0f})" x="12" y="{middle:.0f}">'
            f"{beside}</text>",
        ]
        return (
            f'<svg viewBox="0 0 {w} {h}" width="{w}" height="{h}" role="img">'
            + "".join(self._parts + axes)
            + "</svg>"
        )


def ticks(low: float, high: float, most: int) -> list[float]:
    """Round values between two others, at most about so many, but three."""
    least = (high - low) / max(most, 1)
    ten = 10.0 ** math.floor(math.log10(least))
    found: list[float] = []
    for n in (10, 5, 2, 1, 0.5, 0.2):
        step = n * ten
        if step < least * 0.999 and len(found) >= 3:
            break
        first = math.ceil(low / step - 1e-9)
        found = [round(k * step, 12) for k in range(first, math.floor(high / step + 1e-9) + 1)]
    return found


def plain(value: float) -> str:
    """A number as axes show it."""
    return f"{value:g}".replace("-", "−")


def wide(limits: tuple[float, float]) -> tuple[float, float]:
    """Ends of an axis, apart even where both are the same."""
    low, high = limits
    return (low, high) if high != low else (low - 0.5, low + 0.5)
