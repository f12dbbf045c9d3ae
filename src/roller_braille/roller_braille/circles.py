"""How the paper recognises a dot: its circle in the cleaned image of a cell."""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt

from .reader_settings import Spacing
from .warp import F32, F64

#: Bilateral filter: diameter, px, and spread in grey levels.
_BILATERAL_PX, _BILATERAL_GREY = 5, 60.0
#: CLAHE: clip limit, and tiles along each side.
_CLIP, _TILES = 2.0, 2
#: Binary threshold, grey level of 255.
_THRESHOLD = 76.5
#: Opening and closing: diameter of the element, px.
_ELEMENT_PX = 3
#: Hough transform: votes that a centre needs, and the share by which a radius may differ.
_VOTES, _RADIUS_TOLERANCE = 6.0, 0.35


class CircleFinder:
    """Searches squares around the nodes of a cell for circles the size of a dot.

    Parameters
    ----------
    spacing : Spacing
        Pitch and diameter of dots.
    px_m : float
        Pixel, metres.
    """

    def __init__(self, spacing: Spacing, px_m: float) -> None:
        radius = spacing.dot_diameter_m / 2 / px_m
        self._least = int(radius * (1 - _RADIUS_TOLERANCE))
        self._most = int(np.ceil(radius * (1 + _RADIUS_TOLERANCE)))
        self._half = round(spacing.dot_pitch_m / px_m) // 2
        self._clahe = cv2.createCLAHE(_CLIP, (_TILES, _TILES))
        self._element = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (_ELEMENT_PX, _ELEMENT_PX))

    def find(self, image: F32, at: F64, white: float) -> npt.NDArray[np.bool_]:
        """Whether a circle is found in each of the squares, shape (n,).

        Parameters
        ----------
        image : ndarray of float32
            Events a pixel.
        at : ndarray, shape (n, 2)
            Middles of the squares: column and row in `image`.
        white : float
            Events a pixel that are white.
        """
        half = self._half
        binary = self._clean(image, white)
        padded = cv2.copyMakeBorder(binary, half, half, half, half, cv2.BORDER_CONSTANT)
        found = np.zeros(len(at), np.bool_)
        for i, (c, r) in enumerate(np.floor(at + 0.5).astype(int)):
            if not (0 <= c < image.shape[1] and 0 <= r < image.shape[0]):
                continue
            square = np.ascontiguousarray(padded[r : r + 2 * half + 1, c : c + 2 * half + 1])
            if not square.any():
                continue
            circles = cv2.HoughCircles(
                square, cv2.HOUGH_GRADIENT, 1, minDist=4 * half, param1=200,
                param2=_VOTES, minRadius=self._least, maxRadius=self._most,
            )  # fmt: skip
            if circles is not None:
                x, y, _ = circles[0, 0]
                found[i] = np.hypot(x - half, y - half) <= half / 2
        return found

    def _clean(self, image: F32, white: float) -> npt.NDArray[np.uint8]:
        """The paper's preprocessing: uint8 image of 0 and 255, shape as `image`."""
        grey = np.clip(image * (255.0 / max(white, 1e-9)), 0, 255).astype(np.uint8)
        grey = cv2.bilateralFilter(grey, _BILATERAL_PX, _BILATERAL_GREY, _BILATERAL_PX)
        binary = cv2.threshold(self._clahe.apply(grey), _THRESHOLD, 255, cv2.THRESH_BINARY)[1]
        binary = cv2.morphologyEx(binary, cv2.MORPH_CLOSE, self._element)
        return np.asarray(cv2.morphologyEx(binary, cv2.MORPH_OPEN, self._element), np.uint8)
