"""What the mosaic shows where nothing is: noise, a printed coating, rows that touch nothing."""

from __future__ import annotations

from collections import deque

import numpy as np
import numpy.typing as npt

from .kinds import Kind
from .warp import F32, F64

#: Blocks, whose emptier ones are background, px; parts of the mosaic that it is taken from.
BLOCK_PX, _PARTS = 20, 8
#: Share of the parts, and of the rows, that is emptier than what counts, and how far chance lies
#: below its mean there, by its spread.
_EMPTIER, _BELOW = 0.25, 0.67
#: Root mean square of what is left of the standard normal distribution where twice its spread is
#: taken off.
TAIL = 0.076
#: Share of a row where no relief is taken to be, and how far chance lies off there, by its spread.
_LEVEL, _LEVEL_WITHIN = 0.25, 0.319
#: Rows in which chance spreads less than this share of the median row's touch nothing.
_TOUCHES = 0.3


def _blocks(image: F32) -> F32:
    """An image in rows of blocks, shape (rows of blocks, pixels of a block's height, columns).

    What is left over below goes; columns stay as they are.
    """
    rows = len(image) // BLOCK_PX
    return image[: rows * BLOCK_PX].reshape(rows, BLOCK_PX, image.shape[1])


class Ground:
    """Noise and coating, learnt part by part.

    Rows of blocks run along the roll. Where the skin doesn't lie on the surface, at the upper and
    lower ends of the contact patch, nothing of a coating shows; such rows tell nothing of it.
    """

    def __init__(self) -> None:
        self._rates: dict[Kind, deque[float]] = {kind: deque(maxlen=_PARTS) for kind in Kind}
        self._spreads: deque[F64] = deque(maxlen=_PARTS)
        #: Spread of what a coating's ON and OFF events leave of each other, events.
        self.spread = 0.0
        self._printed: bool | None = None
        self._touching: npt.NDArray[np.bool_] = np.zeros(0, np.bool_)

    @property
    def known(self) -> bool:
        """Whether anything was learnt of the coating."""
        return bool(self._spreads)

    def learn_coating(self, net: F32) -> None:
        """Take ON less OFF events of a part, blurred, shape (rows, columns)."""
        if not net.any():
            return  # as before the roller touches anything
        left = np.quantile(np.abs(_blocks(net)), _LEVEL, axis=(1, 2)) / _LEVEL_WITHIN
        self._spreads.append(left)
        parts = np.stack(self._spreads)
        self.spread = float(np.median(np.median(parts, axis=1)))
        rows = np.quantile(parts, _EMPTIER, axis=0)
        self._touching = rows >= _TOUCHES * np.median(rows)

    @property
    def printed(self) -> bool | None:
        """Whether the coating is printed; None until that is known."""
        return self._printed

    def settle(self, printed: bool) -> None:
        """The coating is printed or it isn't.

        If it is, images, and with them their noise, are others from now on.
        """
        self._printed = printed
        if printed:
            for rates in self._rates.values():
                rates.clear()

    def learn_noise(self, kind: Kind, image: F32, seconds: float) -> None:
        """Take a part of an image of one kind, shape (rows, columns), seen for so long."""
        n = BLOCK_PX
        columns = image.shape[1] // n
        rows = _blocks(image[:, : columns * n])
        blocks = rows.reshape(len(rows), n, columns, n).sum(axis=(1, 3))
        # On a plain coating rows between dots, where nothing is, seem to touch nothing.
        if self.printed and self._touching.any():
            blocks = blocks[self._touching]
        count = float(np.quantile(blocks, _EMPTIER))
        # The emptier quarter of what chance spreads lies so far below its mean.
        count += _BELOW * np.sqrt(count)
        self._rates[kind].append(count / n**2 / max(seconds, 1e-9))

    def noise(self, kind: Kind) -> float:
        """Events a pixel and second where nothing is; 0 before anything was learnt."""
        rates = sorted(self._rates[kind])
        return rates[int(_EMPTIER * len(rates))] if rates else 0.0
