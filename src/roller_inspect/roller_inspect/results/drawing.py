"""A picture of panels with axes, drawn by OpenCV with Pillow's letters.

A plotting library takes longer to load than most runs to process.
"""

from __future__ import annotations

from functools import cache
from importlib.util import find_spec
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
from PIL import Image, ImageDraw, ImageFont

from roller_inspect.report.svg import plain, ticks, wide

F64 = npt.NDArray[np.float64]
RGB = npt.NDArray[np.uint8]
Colour = tuple[int, int, int]

BLACK, BLUE, GREY, LIGHT = (0, 0, 0), (31, 119, 180), (127, 127, 127), (179, 179, 179)
#: Height of letters, px.
TITLE, NORMAL, SMALL = 17, 14, 11
_TICK = 4
#: Lines are placed in fractions of pixels, of so many bits.
_BITS = 4


@cache
def _font(size: int, fixed: bool) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    """DejaVu, which matplotlib brings along, or what there is."""
    found = find_spec("matplotlib")
    folder = Path(found.origin).parent if found and found.origin else Path()
    name = "DejaVuSansMono.ttf" if fixed else "DejaVuSans.ttf"
    try:
        return ImageFont.truetype(str(folder / "mpl-data" / "fonts" / "ttf" / name), size)
    except OSError:
        return ImageFont.load_default(size)


class Picture:
    """A white picture.

    Parameters
    ----------
    width, height : int
        Pixels.
    """

    def __init__(self, width: int, height: int) -> None:
        self._image = Image.new("RGB", (width, height), "white")
        self._draw = ImageDraw.Draw(self._image)

    def text(
        self,
        x: float,
        y: float,
        text: str,
        anchor: str = "ma",
        size: int = NORMAL,
        fixed: bool = False,
        upright: bool = False,
        halo: int = 0,
    ) -> None:
        """Write at a place; `anchor` as Pillow has it, `upright` from below to above.

        A `halo` of some pixels is white around the letters, which on dark colours can be read.
        """
        font = _font(size, fixed)
        if not upright:
            self._draw.text(
                (x, y), text, BLACK, font, anchor, stroke_width=halo, stroke_fill="white"
            )
            return
        left, top, right, bottom = self._draw.textbbox((0, 0), text, font)
        ink = Image.new("L", (round(right - left), round(bottom - top)))
        ImageDraw.Draw(ink).text((-left, -top), text, 255, font)
        ink = ink.rotate(90, expand=True)
        self._image.paste(BLACK, (round(x - ink.width / 2), round(y - ink.height / 2)), ink)

    def rectangle(self, box: tuple[float, float, float, float]) -> None:
        """A frame around a box of left, top, right and bottom."""
        self._draw.rectangle(box, outline=BLACK)

    def tick(self, x: float, y: float, dx: int, dy: int) -> None:
        """A short line from a place."""
        self._draw.line((x, y, x + dx, y + dy), BLACK)

    def paste(self, rgb: RGB, left: int, top: int) -> None:
        """Put a picture into this one."""
        self._image.paste(Image.fromarray(rgb), (left, top))

    def save(self, path: Path) -> None:
        """Write it as PNG."""
        self._image.save(path, compress_level=4)


class Panel:
    """Axes in a picture; what is drawn goes no further than their frame.

    Parameters
    ----------
    picture : Picture
        Where it goes, on `close`.
    box : tuple of int
        Left, top, right and bottom, px.
    x, y : tuple of float
        Values at left and right, at bottom and top.
    title, x_label, y_label : str
        Texts around it.
    equal : bool
        The same scale along both axes, in the middle of the box.
    """

    def __init__(
        self,
        picture: Picture,
        box: tuple[int, int, int, int],
        x: tuple[float, float],
        y: tuple[float, float],
        title: str = "",
        x_label: str = "",
        y_label: str = "",
        equal: bool = False,
    ) -> None:
        self._x, self._y = wide(x), wide(y)
        left, top, right, bottom = box
        width, height = right - left, bottom - top
        if equal:
            spans = abs(self._x[1] - self._x[0]), abs(self._y[1] - self._y[0])
            scale = min(width / spans[0], height / spans[1])
            width, height = (max(round(scale * span), 1) for span in spans)
            left, top = (left + right - width) // 2, (top + bottom - height) // 2
        self.left, self.top, self.width, self.height = left, top, width, height
        self._picture, self._texts = picture, (title, x_label, y_label)
        self._labels: list[tuple[float, float, str, str]] = []
        self.rgb = np.full((height, width, 3), 255, np.uint8)

    def places(self, x: npt.ArrayLike, y: npt.ArrayLike) -> F64:
        """Places of values within the panel, px, shape (n, 2)."""
        (x0, x1), (y0, y1) = self._x, self._y
        u = (np.asarray(x, np.float64) - x0) / (x1 - x0) * self.width
        v = (np.asarray(y, np.float64) - y1) / (y0 - y1) * self.height
        return np.stack([u, v], axis=-1)

    def dots(self, x: npt.ArrayLike, y: npt.ArrayLike, colour: Colour = BLUE) -> None:
        """Dots of two pixels."""
        at = np.floor(self.places(x, y) - 0.5).astype(np.int64)
        for shift in ((0, 0), (0, 1), (1, 0), (1, 1)):
            u, v = (at + shift).T
            inside = (u >= 0) & (v >= 0) & (u < self.width) & (v < self.height)
            self.rgb[v[inside], u[inside]] = colour

    def line(self, x: npt.ArrayLike, y: npt.ArrayLike, colour: Colour = BLACK) -> None:
        """A line."""
        # A pixel's middle is half a pixel from its border; far outside there is nothing to see.
        at = np.clip(self.places(x, y) - 0.5, -9999, 9999) * (1 << _BITS)
        cv2.polylines(
            self.rgb, [np.rint(at).astype(np.int32)], False, colour, 1, cv2.LINE_AA, _BITS
        )

    def bar(self, y: float, thick: float, value: float, colour: Colour) -> None:
        """A bar from 0 to a value, lying."""
        (u0, v0), (u1, v1) = np.rint(self.places([0, value], [y - thick / 2, y + thick / 2]))
        top, bottom = sorted((int(v0), int(v1)))
        self.rgb[max(top, 0) : bottom, max(int(u0), 0) : int(u1)] = colour

    def label(self, x: float, y: float, text: str, anchor: str, dx: int = 0) -> None:
        """Small letters at a place, and some pixels beside it."""
        u, v = self.places(x, y)
        self._labels.append((self.left + u + dx, self.top + v, text, anchor))

    def legend(self, names: list[tuple[str, Colour]]) -> None:
        """What the colours are, at the upper right."""
        for n, (name, colour) in enumerate(names):
            x, y = self.left + self.width - 110, self.top + 14 + 18 * n
            self._labels.append((x + 14, y, name, "lm"))
            v, u = y - self.top, x - self.left
            self.rgb[v - 2 : v + 3, u : u + 8] = colour

    def close(self, x_ticks: bool = True, y_ticks: bool = True, beside: str = "left") -> None:
        """Put it into the picture, with frame, ticks and texts."""
        p, left, top = self._picture, self.left, self.top
        right, bottom = left + self.width, top + self.height
        p.paste(self.rgb, left, top)
        p.rectangle((left - 1, top - 1, right, bottom))
        for x, y, text, anchor in self._labels:
            p.text(x, y, text, anchor, SMALL, halo=1)
        title, x_label, y_label = self._texts
        middle = left + self.width / 2
        p.text(middle, top - 8, title, "md")
        if x_ticks:
            for value in ticks(min(self._x), max(self._x), max(self.width // 55, 2)):
                at = left + int(self.places(value, self._y[0])[0])
                p.tick(at, bottom, 0, _TICK)
                p.text(at, bottom + _TICK + 4, plain(value))
        widest = 0
        if y_ticks:
            outside, way = (right, 1) if beside == "right" else (left - 1, -1)
            for value in ticks(min(self._y), max(self._y), max(self.height // 35, 2)):
                at = top + int(self.places(self._x[0], value)[1])
                p.tick(outside, at, way * _TICK, 0)
                anchor = "lm" if beside == "right" else "rm"
                p.text(outside + way * (_TICK + 4), at, plain(value), anchor)
                widest = max(widest, 9 * len(plain(value)))
        p.text(middle, bottom + 26, x_label)
        at = right + widest + 22 if beside == "right" else left - widest - 22
        p.text(at, top + self.height / 2, y_label, upright=True)


def colours(values: npt.ArrayLike, low: float, high: float, chart: int) -> RGB:
    """Colours of values by one of OpenCV's charts, white where there is none.

    Parameters
    ----------
    values : array_like, shape (...)
        Of any unit; NaN where there is none.
    low, high : float
        Values at the chart's ends; low may be the greater one.
    chart : int
        One of ``cv2.COLORMAP_*``.
    """
    share = (np.asarray(values, np.float64) - low) / (high - low)
    place = np.rint(np.nan_to_num(np.clip(share, 0, 1)) * 255).astype(np.uint8)
    table = cv2.applyColorMap(np.arange(256, dtype=np.uint8), chart)[:, 0, ::-1]
    rgb: RGB = table[place]
    rgb[np.isnan(share)] = 255
    return rgb


def scale_bar(
    picture: Picture, box: tuple[int, int, int, int], low: float, high: float, chart: int,
    label: str, falls: bool = False,
) -> None:  # fmt: skip
    """What colours mean; `falls`: the chart's first colour is that of `high`."""
    bar = Panel(picture, box, (0, 1), (low, high), y_label=label)
    values = np.linspace(high, low, bar.height)[:, None].repeat(bar.width, axis=1)
    bar.rgb[:] = colours(values, *((high, low) if falls else (low, high)), chart)
    bar.close(x_ticks=False, beside="right")
