"""What is learnt of the mosaic where nothing is."""

import numpy as np
import pytest

from roller_braille.ground import BLOCK_PX, Ground
from roller_braille.kinds import Kind

#: Parts of a mosaic: rows by columns.
ROWS, COLUMNS = 16 * BLOCK_PX, 25


def part(rng: np.random.Generator, mean: float) -> np.ndarray:
    return rng.poisson(mean, (ROWS, COLUMNS)).astype(np.float32)


def test_rows_that_touch_nothing_tell_nothing_of_the_coating() -> None:
    """A third of them: noise is that of the others, and the coating is as rough as it is there."""
    rng, ground, whole = np.random.default_rng(0), Ground(), Ground()
    for _ in range(8):
        net, image = rng.normal(0, 5.0, (ROWS, COLUMNS)).astype(np.float32), part(rng, 4.0)
        whole.learn_coating(net)
        whole.learn_noise(Kind.OFF, image, 0.1)
        for values in (net, image):
            values[: ROWS // 6] = values[-ROWS // 6 :] = 0.0
        ground.learn_coating(net)
        if not ground.printed:
            ground.settle(printed=True)
        ground.learn_noise(Kind.OFF, image, 0.1)
    assert whole.spread == pytest.approx(5.0, rel=0.05)
    assert ground.spread == pytest.approx(whole.spread, rel=0.1)
    assert whole.noise(Kind.OFF) == pytest.approx(40.0, rel=0.05)
    assert ground.noise(Kind.OFF) == pytest.approx(40.0, rel=0.05)


def test_noise_is_that_between_dots() -> None:
    """Rows of dots without end, six of them in view, are not what nothing shows."""
    rng, ground = np.random.default_rng(1), Ground()
    for _ in range(8):
        image, net = part(rng, 0.2), rng.normal(0, 0.3, (ROWS, COLUMNS)).astype(np.float32)
        for first in (1, 3, 5, 9, 11, 13):
            dots = slice(first * BLOCK_PX, (first + 1) * BLOCK_PX)
            image[dots] += 20.0
            net[dots] -= 20.0
        ground.learn_coating(net)
        ground.settle(printed=False)
        ground.learn_noise(Kind.OFF, image, 0.1)
    assert ground.noise(Kind.OFF) == pytest.approx(2.0, rel=0.15)
    assert ground.spread == pytest.approx(0.3, rel=0.1)


def test_before_anything_is_touched_the_coating_is_not_known() -> None:
    ground = Ground()
    ground.learn_coating(np.zeros((ROWS, COLUMNS), np.float32))
    assert not ground.known
    assert ground.noise(Kind.OFF) == 0.0
    ground.learn_noise(Kind.OFF, np.full((ROWS, COLUMNS), 2.0, np.float32), 0.1)
    ground.settle(printed=True)
    assert ground.printed
    assert ground.noise(Kind.OFF) == 0.0  # that of another image is forgotten
