"""Plates that lie askew or upside down."""

import numpy as np
import pytest

from braille.synthetic import SETTINGS, SPACING, Plate, over, read, roll_track, scan
from braille.writing import to_masks
from roller_braille.cells import Cell, Seen
from roller_braille.dots import Dots
from roller_braille.lattice import Lattice
from roller_braille.lattice_search import find_lattice, find_turn
from roller_braille.orientation import log_odds, turned, upside_down
from roller_braille.pipeline import BraillePipeline
from roller_braille.table import LETTERS


def turn(plate: Plate, degrees: float) -> Plate:
    """Turn a plate about its corner."""
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    plate.dots = [(c * x - s * y, s * x + c * y, a, b, n) for x, y, a, b, n in plate.dots]
    return plate


def read_plate(plate: Plate, back: bool = False) -> tuple[list[Cell], BraillePipeline]:
    """Read a plate that the roller passes along its middle."""
    ys = [dot[1] for dot in plate.dots]
    track = over(plate, back=back, y=(min(ys) + max(ys)) / 2)
    return read(scan(plate, track), track)


@pytest.mark.parametrize("degrees", [-9.0, 3.0, 10.0])
def test_plates_askew_are_read(degrees: float) -> None:
    cells, pipeline = read_plate(turn(Plate().text("turn it"), degrees))
    assert pipeline.text() == ["turn it"]
    # Cells lie where the plate has them.
    step = np.diff([c.position[:2] for c in cells], axis=0).mean(axis=0)
    assert np.degrees(np.arctan2(step[1], step[0])) == pytest.approx(degrees, abs=0.3)
    assert np.hypot(*step) == pytest.approx(SPACING.cell_pitch_m, rel=0.01)


def test_two_lines_askew_come_in_order() -> None:
    plate = turn(Plate().text("upper", y0=5e-3).text("lower", y0=-5e-3), -4.0)
    assert read_plate(plate)[1].text() == ["upper", "lower"]


def test_a_line_that_leaves_the_view_is_not_guessed_beyond() -> None:
    """At 10° a line enters at one border of the view and leaves at the other."""
    text = "the quick brown fox jumps"
    plate = turn(Plate().text(text), 10.0)
    cells, pipeline = read_plate(plate)
    assert "brown" in pipeline.text()[0]
    c, s = np.cos(np.radians(10.0)), np.sin(np.radians(10.0))
    masks = to_masks(text)
    for cell in cells:
        distance = c * cell.position[0] + s * cell.position[1] - SPACING.dot_pitch_m / 2
        n = round(distance / SPACING.cell_pitch_m)
        assert not cell.readable or cell.mask == masks[n]


def test_letters_after_an_unseen_number_sign_are_not_guessed() -> None:
    """Digits are the letters a to j: which of them is meant hangs on what lies out of view."""
    plate = Plate().text("1234567890 1")
    x = 1.8 * SPACING.cell_pitch_m + SETTINGS.view_half_width_m
    track = roll_track([x, x, 0.12, 0.12], [0.0, 0.1, 0.5, 0.6])
    cells, pipeline = read(scan(plate, track), track)
    masks = [c.mask for c in cells]
    assert len(masks) >= 10
    assert masks == to_masks("1234567890 1")[-len(masks) :]
    (line,) = pipeline.text()
    unseen, seen_whole = line.split(" ")
    assert not any(c.isalnum() for c in unseen)
    assert seen_whole == "1"
    assert not any(c.readable for c in cells[: len(unseen)])


@pytest.mark.parametrize(("degrees", "back"), [(180.0, True), (186.0, False)])
@pytest.mark.parametrize("text", ["upside down", "bad face kit", "no 42, ok?"])
def test_upside_down_is_turned(text: str, degrees: float, back: bool) -> None:
    """`bad face` has no dot in its lowest row: a lattice is laid a row too low at first."""
    cells, pipeline = read_plate(turn(Plate().text(text), degrees), back)
    assert pipeline.text() == [text]
    assert [c.column for c in cells] == list(range(len(to_masks(text))))
    expected = [np.cos(np.radians(degrees)), np.sin(np.radians(degrees))]
    step = np.diff([c.position[:2] for c in cells], axis=0).mean(axis=0)
    np.testing.assert_allclose(step / np.hypot(*step), expected, atol=0.01)


def test_lines_upside_down_come_in_reading_order() -> None:
    plate = turn(Plate().text("first line", y0=5e-3).text("second", y0=-5e-3), 180.0)
    assert read_plate(plate)[1].text() == ["first line", "second"]


def test_what_can_be_read_both_ways_is_left_as_it_is() -> None:
    """`edge` upside down is `eghe`, letter by letter."""
    assert read_plate(turn(Plate().text("edge"), 0.0))[1].text() == ["edge"]
    assert read_plate(turn(Plate().text("edge"), 180.0))[1].text() == ["eghe"]


def seen(mask: int, number: int = 0) -> Seen:
    """A certain cell."""
    nodes = Lattice(0.0, 0.0, 6.2e-3, 2.34e-3, 2.34e-3).nodes(number)
    return Seen(number, mask, (1.0,) * 6, True, nodes, 0)


def test_odds_favour_the_orientation_that_reads() -> None:
    for text in ("the quick brown fox", "lazy dog", "cab"):
        upright = [seen(m) for m in to_masks(text)]
        down = [seen(turned(s.mask)) for s in upright[::-1]]
        assert log_odds(upright, "grade1") > 3.5
        assert log_odds(down, "grade1") < -3.5
        again = upside_down(down)[::-1]
        assert [s.mask for s in again] == [s.mask for s in upright]


def test_contractions_do_not_count_against_a_contracted_code() -> None:
    """Upside down, the sign for `the` is the letter n."""
    the = [seen(0b101110)] * 2
    assert log_odds(the, "grade1") < -7.0
    assert log_odds(the, "ueb2") > -7.0


def test_a_row_that_comes_in_is_as_sure_as_the_cell() -> None:
    """Letters a to j upside down leave the upper row free: lattices lie a row too low."""
    # `b` upside down is dots 5 and 6; seen from a row further down, 4 and 5. `w` needs all rows.
    low = [seen(0b011000), seen(0b011010, 1)]
    (first, _) = upside_down(low)
    assert first.mask == LETTERS["b"]
    assert first.certain
    np.testing.assert_allclose(first.dots[0], [2.34e-3, 2.34e-3], atol=1e-9)


@pytest.mark.parametrize("degrees", [-11.0, -6.0, 0.0, 2.0, 9.0])
def test_turn_and_lattice_of_dots(degrees: float) -> None:
    plate = turn(Plate().text("lynx"), degrees)
    rng = np.random.default_rng(1)
    x, y = (np.array([d[:2] for d in plate.dots]) + rng.normal(0, 5e-5, (len(plate.dots), 2))).T
    order = np.argsort(x)
    dots = Dots(x[order], -y[order], np.full(len(x), 1000.0))
    angle = find_turn(dots, SPACING)
    assert np.degrees(angle) == pytest.approx(-degrees, abs=1.0)
    lattice = find_lattice(dots, SPACING, left_first=True, angle=angle)
    assert lattice is not None
    assert lattice.assign(dots)[0].all()
    assert np.degrees(lattice.angle) == pytest.approx(-degrees, abs=0.3)
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    top = SPACING.dot_pitch_m * np.array([-s, -c])
    np.testing.assert_allclose(lattice.nodes(0)[0], top, atol=3e-4)


def test_too_few_dots_have_no_turn() -> None:
    one = Dots(np.array([0.0, 1e-3]), np.array([0.0, 1e-3]), np.ones(2))
    assert find_turn(one, SPACING) == 0.0
