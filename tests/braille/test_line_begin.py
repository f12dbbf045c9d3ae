"""Lines whose first cells have too few dots to be a line by themselves."""

import numpy as np
import pytest

from braille.synthetic import SPACING, Plate, over, read, scan, text_of

TEXTS = ("A small cat", "A big one", "A bald man", "- item one", "a, b", "I am")


@pytest.mark.parametrize("speed", [0.05, 0.3])
@pytest.mark.parametrize("text", TEXTS)
def test_first_cells_with_few_dots_are_read(text: str, speed: float) -> None:
    plate = Plate().text(text)
    track = over(plate, speed)
    cells, pipeline = read(scan(plate, track), track, chunks=200)
    assert pipeline.text() == [text]
    assert [(c.line, c.column) for c in cells] == [(0, n) for n in range(len(cells))]


@pytest.mark.parametrize("side_m", [(0.0, 0.0008), (0.0008, 0.0), (0.002, 0.0)])
def test_a_dot_before_a_line_that_lies_off_its_lattice_is_none_of_it(
    side_m: tuple[float, float],
) -> None:
    x, y = np.array([-3 * SPACING.cell_pitch_m, SPACING.dot_pitch_m]) + side_m
    plate = Plate([(x, y, 0.0, 6.28, 400)]).text("the quick fox")
    assert text_of(plate) == ["the quick fox"]


def test_half_a_dot_before_a_line_is_none_of_it() -> None:
    plate = Plate([(-3 * SPACING.cell_pitch_m, 0.0, 0.0, 3.14, 200)]).text("the quick fox")
    assert text_of(plate) == ["the quick fox"]


@pytest.mark.parametrize("text", ["the quick fox", "and so on"])
@pytest.mark.parametrize(("node", "off_m"), [(0, (0.0, 6e-4)), (4, (0.0, 6e-4)), (5, (-6e-4, 0.0))])
def test_a_dot_right_before_a_line_that_lies_off_its_nodes_is_none_of_it(
    text: str, node: int, off_m: tuple[float, float]
) -> None:
    """The line is looked for with it, and its lattice gives way to it."""
    pitch = SPACING.dot_pitch_m
    x, y = np.array([node // 3 * pitch - SPACING.cell_pitch_m, (1 - node % 3) * pitch]) + off_m
    plate = Plate([(x, y, 0.0, 6.28, 400)]).text(text)
    assert text_of(plate) == [text]
