"""Lines that begin or end with letters whose dots all lie in the left column: a, b, k, l.

Seen from such an end, one column of dots could be either of a cell.
"""

import numpy as np
import pytest

from braille.synthetic import SPACING, Plate, over, read, scan
from braille.test_lattice import dots_of
from braille.test_turned import turn
from braille.writing import to_masks
from roller_braille.cells import Cell
from roller_braille.lattice_search import find_lattice


def read_turned(text: str, degrees: float, back: bool, chunks: int) -> tuple[list[Cell], list[str]]:
    """Cells and lines of a plate turned about its corner and rolled over along its middle."""
    plate = turn(Plate().text(text), degrees)
    ys = [dot[1] for dot in plate.dots]
    track = over(plate, back=back, y=(min(ys) + max(ys)) / 2)
    cells, pipeline = read(scan(plate, track), track, chunks)
    return cells, pipeline.text()


@pytest.mark.parametrize("back", [False, True])
@pytest.mark.parametrize("degrees", [0.0, 180.0])
@pytest.mark.parametrize(
    "text",
    ["the ball", "ball the", "kabal", "label", "Ball", "12 a", "all balls", "bkl mywtd bl"],
)
def test_the_first_cell_with_two_columns_tells(text: str, degrees: float, back: bool) -> None:
    cells, lines = read_turned(text, degrees, back, chunks=1)
    assert lines == [text]
    assert all(cell.readable for cell in cells)
    assert [c.mask for c in cells] == to_masks(text)
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    along = np.arange(len(cells)) * SPACING.cell_pitch_m + SPACING.dot_pitch_m / 2
    places = np.stack([c * along, s * along], -1)
    np.testing.assert_allclose([cell.position[:2] for cell in cells], places, atol=3e-4)
    # The same cells come at the same place and time, however the events arrive.
    split, _ = read_turned(text, degrees, back, chunks=97)
    assert [(c.line, c.column, c.mask, c.stamp_ns) for c in split] == [
        (c.line, c.column, c.mask, c.stamp_ns) for c in cells
    ]


@pytest.mark.parametrize("text", ["all", "abba", "bb", "kabala"])
@pytest.mark.parametrize("back", [False, True])
def test_of_cells_of_one_column_it_is_the_left(text: str, back: bool) -> None:
    assert read_turned(text, 0.0, back, chunks=1)[1] == [text]


@pytest.mark.parametrize(("text", "looks"), [("all", "ll'"), ("bb", "bb"), ("kk", "kk")])
def test_one_column_that_is_text_both_ways_is_left_as_it_is(text: str, looks: str) -> None:
    assert read_turned(text, 180.0, back=False, chunks=1)[1] == [looks]


def test_fewer_dots_than_a_line_needs_give_none() -> None:
    assert read_turned("a", 180.0, back=False, chunks=1)[1] == []


def test_dots_of_one_column_fit_either_those_of_two_only_their_own() -> None:
    pitch = SPACING.dot_pitch_m
    for text, back in (("bkl", 7.0), ("bkl d", 8.0)):  # of `d` one dot lies in the left column
        dots = dots_of(text)
        lattice = find_lattice(dots, SPACING, left_first=True)
        assert lattice is not None
        assert lattice.column_fit(dots) == pytest.approx(len(dots), abs=0.1)
        assert lattice.shifted(-pitch, 0.0).column_fit(dots) == pytest.approx(back, abs=0.1)
        # Rows don't count, where the dots lie on some.
        lower = lattice.shifted(0.0, pitch)
        assert lower.column_fit(dots) == pytest.approx(len(dots), abs=0.1)
        assert lower.fit_of(dots) < len(dots) - 1
