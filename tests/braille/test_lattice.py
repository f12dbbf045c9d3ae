"""Finding and following the lattice of a line."""

import numpy as np
import pytest

from braille.synthetic import SPACING
from braille.writing import to_masks
from roller_braille.dots import Dots
from roller_braille.lattice import Lattice
from roller_braille.lattice_search import _find_rows, find_lattice

DOT, CELL = SPACING.dot_pitch_m, SPACING.cell_pitch_m


def dots_of(text: str, scale: float = 1.0, slope: float = 0.0, noise_m: float = 0.0) -> Dots:
    """Dots of a text, in travel and down the image, first cell at (0.01, -0.002)."""
    rng = np.random.default_rng(3)
    places = []
    for n, mask in enumerate(to_masks(text)):
        for dot in range(6):
            if mask >> dot & 1:
                x = (n * CELL + dot // 3 * DOT) * scale
                places.append((0.01 + x, -0.002 + dot % 3 * DOT * scale + slope * x))
    x, y = (np.array(places) + rng.normal(0, noise_m, (len(places), 2))).T
    order = np.argsort(x)
    return Dots(x[order], y[order], np.full(len(x), 1000.0))


@pytest.mark.parametrize("text", ["dog", "lynx", "abc", "roll", "4x", "st"])
@pytest.mark.parametrize("scale", [0.975, 1.0, 1.025])
def test_lattice_is_found(text: str, scale: float) -> None:
    dots = dots_of(text, scale, slope=0.01, noise_m=5e-5)
    found = find_lattice(dots, SPACING, left_first=True)
    assert found is not None
    on, index = found.assign(dots)
    assert on.all()
    assert index[:, 0].min() == 0
    np.testing.assert_allclose(found.nodes(0)[0], [0.01, -0.002], atol=4e-4)


def test_left_column_and_upper_row_are_taken_where_it_is_open() -> None:
    """`a` and `c` alone could be other cells one row down or one column to the right."""
    dots = dots_of("a a a")
    first = find_lattice(dots, SPACING, left_first=True)
    second = find_lattice(dots, SPACING, left_first=False)
    assert first is not None
    assert second is not None
    np.testing.assert_allclose(first.nodes(0)[0], [0.01, -0.002], atol=1e-4)
    np.testing.assert_allclose(second.nodes(0)[3], [0.01, -0.002], atol=1e-4)


def test_dust_does_not_move_the_lattice() -> None:
    dots = dots_of("abc")
    dust = Dots(np.array([0.012, 0.018]), np.array([-0.0043, -0.0043]), np.array([40.0, 30.0]))
    found = find_lattice(dots.joined(dust), SPACING, left_first=True)
    assert found is not None
    np.testing.assert_allclose(found.nodes(0)[0], [0.01, -0.002], atol=1e-4)


def test_no_dots_no_lattice() -> None:
    assert find_lattice(Dots.none(), SPACING, left_first=True) is None


def test_rows_that_begin_later_give_no_lattice() -> None:
    above = Dots(np.array([0.008]), np.array([-0.0095]), np.array([1000.0]))
    dots = above.joined(dots_of("abc"))
    assert find_lattice(dots, SPACING, left_first=True) is not None
    assert find_lattice(dots, SPACING, left_first=True, begins_m=0.009) is None


def test_rows_hold_the_most_weight() -> None:
    rng = np.random.default_rng(4)
    pitches, width = DOT * np.linspace(0.96, 1.04, 7), DOT / 4
    for n in (3, 10, 30):
        down, weight = rng.uniform(-8e-3, 8e-3, n), rng.uniform(40, 400, n)
        top, pitch, near = _find_rows(down, weight, pitches, width)

        def score(top: float, pitch: float, down=down, weight=weight) -> float:  # type: ignore[no-untyped-def]
            off = np.abs(top + pitch * np.arange(3)[:, None] - down)
            each = (np.maximum(1 - off / (2 * width), 0) * weight).sum(axis=1)
            uneven = abs(pitch - DOT) / (0.04 * DOT)
            return float(each @ [1, 0.94, 0.88]) * (1 - 0.01 * uneven)

        tops = np.arange(down.min() - 2 * pitches[-1], down.max(), 1e-4)
        best = max(score(a, b) for a in tops for b in pitches)
        assert score(top, pitch) == pytest.approx(best)
        off = np.abs(top + pitch * np.arange(3)[:, None] - down)
        assert (near == (off < 2 * width).any(axis=0)).all()


def test_cells_and_nodes() -> None:
    lattice = Lattice(0.01, -0.002, CELL, DOT, DOT, angle=0.02)
    nodes = lattice.nodes(2)
    np.testing.assert_allclose(
        nodes[0], [0.01 + 2 * CELL * np.cos(0.02), -0.002 + 2 * CELL * np.sin(0.02)]
    )
    np.testing.assert_allclose(
        nodes[3:] - nodes[:3], [[DOT * np.cos(0.02), DOT * np.sin(0.02)]] * 3
    )
    np.testing.assert_allclose(lattice.moved(2).nodes(0), nodes)
    np.testing.assert_allclose(lattice.centre(2), nodes.mean(axis=0))
    assert lattice.begin == pytest.approx(lattice.centre(0)[0] - CELL / 2 * np.cos(0.02))
    on, index = lattice.assign(Dots(nodes[:, 0], nodes[:, 1], np.ones(6)))
    assert on.all()
    np.testing.assert_array_equal(index[:, 0], 2)
    np.testing.assert_array_equal(index[:, 1], [0, 0, 0, 1, 1, 1])
    np.testing.assert_array_equal(index[:, 2], [0, 1, 2, 0, 1, 2])
