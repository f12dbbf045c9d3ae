"""Spots found in a mosaic."""

import numpy as np

from roller_braille.dots import DotFinder
from roller_braille.kinds import Kind
from roller_braille.reader_settings import BrailleSettings
from roller_braille.strip import PX_M, Strip
from roller_braille.warp import Knots

SETTINGS = BrailleSettings.create({})


def test_a_spot_with_nothing_around_it_is_found_once() -> None:
    """As many of its events lie within a dot's reach of several places."""
    strip = Strip(SETTINGS, 0.01)
    image = np.zeros((strip.rows, 400), np.float32)
    image[160:166, 200:206] = 20.0
    strip.image = lambda a, b, kind: image[:, a + 100 : b + 100]  # type: ignore[method-assign,assignment,misc]
    strip.exposure.add(Knots(np.array([0, 1]), np.zeros((2, 3, 3)), np.array([-0.1, 0.1])))
    dots = DotFinder(SETTINGS.spacing).find(strip, 0, 200, Kind.OFF, learn=False)
    assert len(dots) == 1
    assert abs(dots.along[0] - 102.5 * PX_M) < 2e-4
