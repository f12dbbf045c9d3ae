"""The middle of a dot from what its flanks leave, odd about it."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from roller_braille.dot_centre import DotCentre
from roller_braille.reader_settings import PROFILES

SPACING = PROFILES["nls"]
PX_M = 6e-5


def image_of(middles_px: np.ndarray, odd: bool, wide: int = 400, high: int = 60) -> np.ndarray:
    """ON less OFF events of dots in a row, at each edge one kind before the other."""
    x = np.arange(wide) + 0.5
    y = np.arange(high)[:, None] + 0.5
    net = np.zeros((high, wide), np.float32)
    for middle in middles_px:
        for side, weight in ((-11.0, -4.0), (-4.0, 1.5), (4.0, -1.5), (11.0, 4.0)):
            sign = 1.0 if odd else float(np.sign(side)) * -1.0
            net += sign * weight * np.exp(-((x - middle - side) ** 2) / 6) * (abs(y - 30) < 8)
    return net


@given(
    off_px=st.floats(-13.0, 13.0), seed=st.integers(0, 99), sign=st.sampled_from([-1, 1]),
    count=st.integers(1, 6),
)  # fmt: skip
def test_the_middle_is_found_beneath_a_coating(
    off_px: float, seed: int, sign: int, count: int
) -> None:
    """Nodes lie off the middles by the same; spots of a coating are as many ON as OFF."""
    nodes = 60.0 + 39.0 * np.arange(count) + seed / 99
    net = sign * image_of(nodes + off_px, odd=True)
    net += np.random.default_rng(seed).normal(0.0, 0.1, net.shape).astype(np.float32)
    centre = DotCentre(SPACING, PX_M)
    centre.add(net, np.stack([nodes, np.full(count, 30.5)], -1))
    assert abs(centre.off_m / PX_M - off_px) < 0.3


def test_dots_that_are_not_odd_stay_where_they_are() -> None:
    nodes = 60.0 + 39.0 * np.arange(6)
    at = np.stack([nodes, np.full(6, 30.5)], -1)
    for net in (image_of(nodes + 5, odd=False), np.abs(image_of(nodes + 5, odd=True))):
        centre = DotCentre(SPACING, PX_M)
        centre.add(net.astype(np.float32), at)
        assert centre.off_m == 0.0


def test_one_dot_is_enough_and_none_is_no_fault() -> None:
    """A line may begin with an a: its cells lie as all others."""
    centre = DotCentre(SPACING, PX_M)
    centre.add(np.zeros((0, 0), np.float32), np.empty((0, 2)))
    assert centre.off_m == 0.0
    centre.add(image_of(np.array([65.0]), odd=True), np.array([[60.0, 30.5]]))
    assert abs(centre.off_m / PX_M - 5.0) < 0.3


def test_dots_at_the_images_edge_count_as_far_as_they_are_there() -> None:
    centre = DotCentre(SPACING, PX_M)
    net = image_of(np.array([4.0, 200.0]), odd=True)[25:]
    centre.add(net, np.array([[0.0, 5.5], [196.0, 5.5]]))
    assert abs(centre.off_m / PX_M - 4.0) < 1.0
