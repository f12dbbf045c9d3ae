"""What dots look like on a printed coating."""

import cv2
import numpy as np
import pytest

from roller_braille.dot_shape import DotShape, medians
from roller_braille.dots import Dots
from roller_braille.reader_settings import BrailleSettings
from roller_braille.recognise import Reading
from roller_braille.strip import PX_M

SPACING = BrailleSettings.create({}).spacing
#: Columns and rows of a mosaic, and where its first cell lies in it.
COLUMNS, ROWS, FIRST = 2200, 300, (100.0, 110.0)
PITCH, CELL = SPACING.dot_pitch_m / PX_M, SPACING.cell_pitch_m / PX_M


def nodes(cell: int) -> np.ndarray:
    """Columns and rows of a cell's six nodes."""
    column, row = np.repeat([0, 1], 3), np.tile([0, 1, 2], 2)
    return np.array(FIRST) + np.stack([cell * CELL + column * PITCH, row * PITCH], -1)


def mosaic(rng: np.random.Generator, masks: list[int], roughness: float) -> np.ndarray:
    """ON less OFF events: as brightness changes along the roll, dark rings on a spotted ground."""
    light = cv2.GaussianBlur(rng.standard_normal((ROWS, COLUMNS)), (0, 0), 1.7)
    light *= roughness / light.std()
    y, x = np.mgrid[:ROWS, :COLUMNS]
    for cell, mask in enumerate(masks):
        for dot, (c, r) in enumerate(nodes(cell)):
            if mask >> dot & 1:
                away = np.hypot(x - c, y - r)
                light -= np.exp(-(((away - 9.0) / 4.0) ** 2))
    return np.asarray(300.0 * np.gradient(light, axis=1), np.float32)


def shape_of(net: np.ndarray, rng: np.random.Generator, masks: list[int], miss: float) -> DotShape:
    """A pattern learnt from spots that were found up to so far off their dots, metres."""
    at = np.concatenate(
        [
            nodes(cell)[[bool(mask >> dot & 1) for dot in range(6)]]
            for cell, mask in enumerate(masks)
        ]
    )
    at = at + rng.uniform(-miss, miss, at.shape) / PX_M
    shape = DotShape(SPACING, PX_M)
    for part in np.array_split(np.arange(len(at)), 5):
        along, down = at[part].T * PX_M
        shape.add(net, at[part], Dots(along, down, np.ones(len(part))))
    return shape


def read(shape: DotShape, net: np.ndarray, cell: int) -> Reading:
    at = nodes(cell)
    middle = float(at[:, 0].mean()) * PX_M
    half = SPACING.cell_pitch_m / 2
    a, b = int(at[:, 0].min() - shape.reach), int(at[:, 0].max() + shape.reach)
    part, at = net[:, max(a, 0) : b], at - [max(a, 0), 0]
    reading = shape.read(part, at, middle - half, middle + half)
    assert reading is not None
    return reading


@pytest.mark.parametrize("roughness", [0.05, 0.12])
def test_dots_are_told_from_a_coatings_spots(roughness: float) -> None:
    rng = np.random.default_rng(5)
    masks = [0b011110, 0b010011, 0b010001, 0, 0b011111, 0b100101, 0b111101, 0b001010, 0b000001] * 2
    net = mosaic(rng, masks, roughness)
    shape = shape_of(net, rng, masks, 2e-4)
    for cell, mask in enumerate(masks):
        reading = read(shape, net, cell)
        assert int((reading.raised << np.arange(6)).sum()) == mask
        assert reading.confidence.min() > 0.4


def test_dots_are_placed_better_than_they_were_found() -> None:
    rng = np.random.default_rng(6)
    masks = [0b011110, 0b010011, 0b010001, 0b011111]
    dots = shape_of(mosaic(rng, masks, 0.2), rng, masks, 2.5e-4).dots
    true = np.concatenate([nodes(k) for k in range(len(masks))]) * PX_M
    off = np.stack([dots.along, dots.down], -1)[:, None] - true
    off = np.take_along_axis(off, np.hypot(*off.T).T.argmin(1)[:, None, None], 1)[:, 0]
    assert len(dots) == sum(m.bit_count() for m in masks)
    # How far all lie off alike, says nothing: the lattice is laid under them.
    assert np.std(off, axis=0).max() < 0.05e-3


def test_other_relief_is_no_dot_and_no_empty_place() -> None:
    rng = np.random.default_rng(7)
    masks = [0b011110, 0b010011, 0b010001, 0b000001]
    net = mosaic(rng, masks, 0.1)
    shape = shape_of(net, rng, masks, 1e-4)
    c, r = nodes(3)[4]
    # A step down along the roll, as of an edge.
    net[int(r) - 15 : int(r) + 15, int(c) - 3 : int(c) + 3] += 150.0
    reading = read(shape, net, 3)
    assert reading.confidence[0] > 0.4
    assert reading.confidence[4] < 0.4


def test_of_few_dots_nothing_is_known() -> None:
    rng = np.random.default_rng(8)
    net = mosaic(rng, [0b000011], 0.1)
    shape = shape_of(net, rng, [0b000011], 0.0)
    at = nodes(1)
    middle = float(at[:, 0].mean()) * PX_M
    assert shape.read(net[:, :400], at, middle - 1e-3, middle + 1e-3) is None


@pytest.mark.parametrize("count", [1, 2, 7, 24])
def test_the_median_of_patches_is_numpys(count: int) -> None:
    patches = np.random.default_rng(count).normal(size=(count, 9, 11)).astype(np.float32)
    kept = patches.copy()
    np.testing.assert_array_equal(medians(patches), np.median(patches, axis=0))
    np.testing.assert_array_equal(patches, kept)
