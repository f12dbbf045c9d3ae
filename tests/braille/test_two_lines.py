"""Two lines that are in view together, on a plate whose rows all lie on one grid.

At Marburg spacing lines are four rows apart: three rows may be the lowest of one line and the
uppermost of the next.
"""

import numpy as np
import pytest

from braille.synthetic import Plate, over, read, scan
from braille.writing import to_masks
from roller_braille.dots import Dots
from roller_braille.lattice_search import find_lattice
from roller_braille.reader_settings import PROFILES

MARBURG = PROFILES["marburg"]


def two_lines(upper: str, lower: str) -> Plate:
    """A plate at Marburg spacing, the middle between its lines at y = 0."""
    plate = Plate()
    for text, y0 in ((upper, MARBURG.line_pitch_m / 2), (lower, -MARBURG.line_pitch_m / 2)):
        for n, mask in enumerate(to_masks(text)):
            for dot in range(6):
                if mask >> dot & 1:
                    x = n * MARBURG.cell_pitch_m + dot // 3 * MARBURG.dot_pitch_m
                    plate.dots.append((x, y0 + (1 - dot % 3) * MARBURG.dot_pitch_m, 0, 6.28, 400))
    return plate


@pytest.mark.parametrize(
    ("upper", "lower"),
    [
        ("- Ivvf S lhft", "Atfym w hwvyds"),
        ("- Upper", "lower"),
        ("Above", "- below"),
        ("the upper one", "A lower one"),
    ],
)
@pytest.mark.parametrize("back", [False, True])
def test_rows_are_not_shared_between_lines(upper: str, lower: str, back: bool) -> None:
    plate = two_lines(upper, lower)
    # So that a row above the upper line would be in view.
    track = over(plate, back=back, y=1e-3)
    assert read(scan(plate, track), track)[1].text() == [upper, lower]


def test_rows_of_a_line_that_begins_first_are_found_beside_those_of_one_with_more_dots() -> None:
    # Within the window the upper line has four dots, the lower one nine.
    x, y = np.array([dot[:2] for dot in two_lines("- i", " lll").dots]).T
    order = np.argsort(x, kind="stable")
    dots = Dots(x[order], -y[order], np.full(len(x), 1000.0))
    found = find_lattice(dots, MARBURG, left_first=True, begins_m=MARBURG.dot_pitch_m / 2)
    assert found is not None
    np.testing.assert_allclose(found.nodes(0)[0], [0.0, -7.5e-3], atol=2e-4)


@pytest.mark.parametrize("text", ["- One thing", "- A man", "- I am"])
@pytest.mark.parametrize("back", [False, True])
def test_a_hyphen_and_a_capital_sign_do_not_lower_the_rows(text: str, back: bool) -> None:
    plate = Plate().text(text)
    track = over(plate, back=back)
    assert read(scan(plate, track), track)[1].text() == [text]
