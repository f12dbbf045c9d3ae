"""The mosaic of warped events, a strip fixed to the surface."""

from __future__ import annotations

import cv2
import numpy as np

from roller_core.events import EventArray

from .exposure import Exposure
from .ground import BLOCK_PX, TAIL, Ground
from .kinds import Kind
from .reader_settings import BrailleSettings
from .warp import F32, F64, I64, Knots, vote

#: Pixel of the mosaic, metres: a dot has some 24 across, a sensor's pixel shows 43 micrometres.
PX_M = 6e-5
_MARGIN_M = 0.002
#: Columns by which the mosaic grows. Of a power of two, rows would share the same few lines of a
#: core's cache.
_MORE_COLUMNS = 1000
#: Blur under which a printed coating's ON and OFF events make up for each other, by a dot's
#: diameter, and how many times the spread of what they leave is taken off.
_BLUR, _TAKEN_OFF = 1 / 5, 2.0


class Strip:
    """Counts of warped events on the surface, over the part of a pass that is still needed.

    OFF and ON events are counted apart; an image takes one kind or both. The spots of a printed
    coating give as many of either as they pass, the shading of a dot's flanks doesn't: on such a
    coating an image of one kind shows by how much it outnumbers the other.

    Columns run along the travel of the sensor, in whichever direction it rolls, rows down the
    image. A column is numbered by its place: column c is at c times the pixel's size from where the
    pass began.

    Parameters
    ----------
    settings : BrailleSettings
        Pixel size and width of the view.
    half_height_m : float
        Half height of the view.
    """

    def __init__(self, settings: BrailleSettings, half_height_m: float) -> None:
        self.px_m = PX_M
        self._half = settings.view_half_width_m
        #: What of the surface was in view, and how long.
        self.exposure = Exposure(self.px_m, self._half, settings.read_at_m)
        self._rows = int(np.ceil(2 * (half_height_m + _MARGIN_M) / self.px_m))
        #: Place down the image of the first row, metres.
        self.top_m = -self._rows / 2 * self.px_m
        self._first = 0
        self._counts: F32 = np.zeros((2, self._rows, 0), np.float32)
        self._newest: I64 = np.zeros(0, np.int64)
        self._begun = False
        self._until_ns = 0
        self.events = 0
        #: What is known of noise and coating.
        self.ground = Ground()
        self._blur_px = settings.spacing.dot_diameter_m * _BLUR / self.px_m
        # What `_net` gave so far, and the column that it begins at; until more events come.
        self._blurred, self._blurred_from = np.zeros((self._rows, 0), np.float32), 0

    @property
    def rows(self) -> int:
        """Rows."""
        return self._rows

    @property
    def first(self) -> int:
        """First column kept."""
        return self._first

    def row(self, down_m: F64) -> F64:
        """Rows of places down the image."""
        return np.asarray((down_m - self.top_m) / self.px_m)

    def add(self, events: EventArray, table: F32, knots: Knots) -> None:
        """Warp a batch of events and count them."""
        if not self._begun:
            self._begun = True
            self._first = int(np.floor((float(knots.along[0]) - self._half) / self.px_m))
        self._until_ns = int(knots.times_ns[-1])
        self.exposure.add(knots)
        self._reserve(int((float(knots.along.max()) + self._half) / self.px_m) + 16)
        raster = np.array(
            [
                [1 / self.px_m, 0.0, -float(self._first)],
                [0.0, 1 / self.px_m, -self.top_m / self.px_m],
                [0.0, 0.0, 1.0],
            ]
        )
        self._blurred = self._blurred[:, :0]
        self.events += vote(events, table, knots, raster, self._counts, self._newest)

    def learn_coating(self, a: int, b: int, area_px: float, least: float, settled: bool) -> bool:
        """Learn from columns a to b (b excluded) what the coating is like.

        Parameters
        ----------
        a, b : int
            Columns.
        area_px, least : float
            A spot's area, and events that it needs: the coating is printed if what its events
            leave there could make up as many.
        settled : bool
            Whether a coating that was taken for plain stays so.

        Returns
        -------
        bool
            Whether it was taken for plain till now and isn't any more: images are others.
        """
        shown = a + np.flatnonzero(
            self.exposure.shown(np.arange(a, b, dtype=np.float64) * self.px_m)
        )
        ground, before = self.ground, self.printed
        if len(shown):
            edge = int(np.ceil(_MARGIN_M / self.px_m))
            ground.learn_coating(self._net(int(shown[0]), int(shown[-1]) + 1)[edge:-edge])
        if before or settled or not ground.known:
            return False
        ground.settle(self._left(area_px) > least)
        return bool(ground.printed) and before is not None

    @property
    def printed(self) -> bool | None:
        """Whether the coating is printed; None until that is known."""
        return self.ground.printed

    def coating(self, area_px: float) -> float:
        """By how much what a printed coating's events leave in an area varies, events."""
        return self._left(area_px) if self.printed else 0.0

    def _left(self, area_px: float) -> float:
        return TAIL * self.ground.spread * float(np.sqrt(4 * np.pi * area_px)) * self._blur_px

    def background(self, a: int, b: int, kind: Kind) -> float:
        """Events a pixel of columns a to b (b excluded) where nothing is.

        Noise comes at a rate in time, so a part that was rolled over slowly has more of it. The
        rate is that of the emptier parts seen so far.
        """
        return self.ground.noise(kind) * self.exposure.seconds(a, b)

    def learn_background(self, a: int, b: int, kind: Kind) -> None:
        """Take the rate of noise from columns a to b (b excluded), where there is least in them."""
        shown = np.flatnonzero(self.exposure.share(a, b) >= 0.5)
        if not len(shown):
            return
        b = a + int(shown[-1]) + 1
        a += int(shown[0])
        # Rows that the camera does not see hold nothing, not even noise.
        edge = int(np.ceil(_MARGIN_M / self.px_m))
        image = self.image(a, b, kind)[edge:-edge]
        if min(image.shape) >= BLOCK_PX:
            self.ground.learn_noise(kind, image, self.exposure.seconds(a, b))

    def forget_before(self, column: int) -> None:
        """Columns before this one are no longer needed."""
        # Moving what is kept costs; do it once in a while.
        keep = column - self._first
        if 512 < keep < self._counts.shape[2]:
            self._blurred = self._blurred[:, :0]
            self._counts[..., :-keep] = self._counts[..., keep:].copy()
            self._counts[..., -keep:] = 0.0
            self._newest[:-keep] = self._newest[keep:].copy()
            self._newest[-keep:] = 0
            self._first = column
            self.exposure.forget_before(column * self.px_m)

    def image(self, a: int, b: int, kind: Kind, top: int = 0, bottom: int | None = None) -> F32:
        """Counts of columns a to b (b excluded), as if all were seen over the full travel.

        Returns
        -------
        ndarray of float32, shape (bottom - top, b - a)
            Events a pixel of rows `top` to `bottom`; 0 where nothing is kept.
        """
        rows = top, self._rows if bottom is None else bottom
        if rows[0] >= rows[1]:
            return np.zeros((0, b - a), np.float32)
        if not self.printed or kind is Kind.BOTH:
            return self._counted(a, b, kind, *rows)
        net = self._net(a, b)[slice(*rows)]
        taken = np.float32(_TAKEN_OFF * self.ground.spread)
        out = net - taken if kind is Kind.ON else -taken - net
        return np.maximum(out, np.float32(0.0), out=out)

    def _net(self, a: int, b: int) -> F32:
        """ON events less OFF events of columns a to b (b excluded), blurred, as `image`.

        Parts that are asked for overlap: each column is blurred once.
        """
        if not self._blurred.shape[1]:
            self._blurred_from = a
        begin = self._blurred_from
        end = begin + self._blurred.shape[1]
        before, after = self._blur(a, begin), self._blur(end, b)
        if before.size or after.size:
            self._blurred = np.concatenate([before, self._blurred, after], axis=1)
            self._blurred_from = begin = min(a, begin)
        return self._blurred[:, a - begin : b - begin]

    def _blur(self, a: int, b: int) -> F32:
        """What `_net` gives, worked out; nothing where b isn't beyond a."""
        if b <= a:
            return np.zeros((self._rows, 0), np.float32)
        reach = int(np.ceil(4 * self._blur_px)) + 1  # of OpenCV's blur
        net = self.net(a - reach, b + reach, 0, self._rows)
        blurred = cv2.GaussianBlur(net, (0, 0), self._blur_px)
        return np.asarray(blurred[:, reach:-reach], np.float32)

    def net(self, a: int, b: int, top: int, bottom: int) -> F32:
        """ON events less OFF events, as `image`."""
        if top >= bottom:
            return np.zeros((0, b - a), np.float32)
        on, off = (self._counted(a, b, kind, top, bottom) for kind in (Kind.ON, Kind.OFF))
        on -= off
        return on

    def _counted(self, a: int, b: int, kind: Kind, top: int, bottom: int) -> F32:
        """Events of a kind, as `image`."""
        out = np.zeros((bottom - top, b - a), np.float32)
        lo, hi = max(a, self._first), min(b, self._first + self._counts.shape[2])
        if lo < hi:
            gain = self.exposure.gain(lo, hi)
            parts = self._counts[:, top:bottom, lo - self._first : hi - self._first]
            part = parts[0] + parts[1] if kind is Kind.BOTH else parts[int(kind is Kind.ON)]
            np.multiply(part, gain, out=out[:, lo - a : hi - a])
        return out

    def newest_ns(self, a: int, b: int) -> int:
        """Time of the newest event in columns a to b (b excluded), or up to which none came."""
        part = self._newest[max(a - self._first, 0) : max(b - self._first, 0)]
        return int(part.max(initial=0)) or self._until_ns

    def _reserve(self, column: int) -> None:
        have = self._counts.shape[2]
        need = column - self._first
        if need > have:
            more = max(need - have, _MORE_COLUMNS)
            more_counts = np.zeros((2, self._rows, more), np.float32)
            self._counts = np.concatenate([self._counts, more_counts], axis=2)
            self._newest = np.append(self._newest, np.zeros(more, np.int64))


def image_around(strip: Strip, nodes: F64, margin_px: int, kind: Kind) -> tuple[F32, F64]:
    """Part of the mosaic around nodes, and the nodes' columns and rows in it."""
    (a, b, top, bottom), at = _around(strip, nodes, margin_px)
    return strip.image(a, b, kind, top, bottom), at


def net_around(strip: Strip, nodes: F64, margin_px: int) -> tuple[F32, F64]:
    """ON less OFF events around nodes, and the nodes' columns and rows there."""
    part, at = _around(strip, nodes, margin_px)
    return strip.net(*part), at


def _around(strip: Strip, nodes: F64, margin_px: int) -> tuple[tuple[int, int, int, int], F64]:
    """Columns and rows, from and up to, around nodes; the nodes' columns and rows there."""
    columns = nodes[:, 0] / strip.px_m
    a, b = int(columns.min()) - margin_px, int(columns.max()) + margin_px + 1
    rows = (nodes[:, 1] - strip.top_m) / strip.px_m
    top, bottom = max(int(rows.min()) - margin_px, 0), int(rows.max()) + margin_px + 1
    part = a, b, top, min(bottom, strip.rows)
    return part, np.stack([columns - a, rows - top], axis=-1)
