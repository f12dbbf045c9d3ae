"""Plates and rolls that are not as they should be: what is in doubt is not given as text."""

import numpy as np
import pytest

from braille.synthetic import SPACING, Plate, over, read, roll_track, scan, text_of
from braille.writing import to_masks
from roller_braille.table import UNREADABLE

CELL, DOT = SPACING.cell_pitch_m, SPACING.dot_pitch_m
RING = (0.0, 2 * np.pi)


def in_cell(plate: Plate, n: int) -> int:
    """Index of the first dot of a cell."""
    return next(i for i, d in enumerate(plate.dots) if d[0] > n * CELL - 1e-4)


@pytest.mark.parametrize("share", [0.3, 0.5])
def test_a_worn_dot_is_not_taken_for_none(share: float) -> None:
    """Without its dot, `i` would be another cell."""
    plate = Plate().text("missing dots")
    x, y, a, b, count = plate.dots[in_cell(plate, 4)]
    plate.dots[in_cell(plate, 4)] = (x, y, a, b, int(share * count))
    assert text_of(plate) == [f"miss{UNREADABLE}ng dots"]


@pytest.mark.parametrize("off", [(0.4, -0.2), (-0.4, 0.2), (0.0, 0.42)])
def test_a_dot_astray_makes_no_other_letter(off: tuple[float, float]) -> None:
    """One more dot would make `h` a `g`, if it lay where dots lie."""
    plate = Plate().text("extra here")
    x, y = 6 * CELL + DOT + off[0] * 1e-3, DOT + off[1] * 1e-3
    plate.dots.append((x, y, *RING, 400))
    track = over(plate)
    cells, pipeline = read(scan(plate, track), track)
    assert pipeline.text() == [f"extra {UNREADABLE}ere"]
    assert not cells[6].readable


@pytest.mark.parametrize("seed", range(4))
def test_dots_between_dots_make_no_other_letter(seed: int) -> None:
    plate = Plate().text("some more dots")
    rng = np.random.default_rng(seed)
    for _ in range(3):
        # Between the columns, or between the cells.
        x = rng.integers(0, 13) * CELL + rng.choice([DOT / 2, (DOT + CELL) / 2])
        plate.dots.append((x, rng.uniform(-DOT, DOT), *RING, 400))
    track = over(plate)
    cells, _ = read(scan(plate, track), track)
    truth = to_masks("some more dots")
    places = [(c, round((c.position[0] - DOT / 2) / CELL)) for c in cells]
    assert all(c.mask == truth[n] for c, n in places if c.readable)
    assert sum(c.readable for c in cells) >= 8


@pytest.mark.parametrize("degrees", [0, 40, 90, 140])
def test_a_scratch_spoils_its_cells_alone(degrees: int) -> None:
    text = "plain scratch text"
    plate = Plate().text(text)
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    for step, side in np.ndindex(160, 2):
        along, across = step * 5e-5 - 4e-3, side * 4e-4 - 2e-4
        # Part of a ring that is but a point.
        x, y = 7.4 * CELL + along * c - across * s, along * s + across * c
        plate.dots.append((x - SPACING.dot_diameter_m / 2, y, 0.0, 0.0, 15))
    track = over(plate)
    cells, pipeline = read(scan(plate, track), track)
    (line,) = pipeline.text()
    assert len(line) == len(text)
    assert all(
        a == b or not cells[n].readable for n, (a, b) in enumerate(zip(line, text, strict=True))
    )
    assert line[:5] == text[:5]
    assert line[-6:] == text[-6:]
    assert 1 <= sum(not cell.readable for cell in cells) <= 4


@pytest.mark.parametrize("pause_s", [0.5, 3.0])
def test_a_stop_in_mid_line_changes_nothing(pause_s: float) -> None:
    plate = Plate().text("stop and go on")
    clock = np.cumsum([0.0, 0.1, 0.2, pause_s, 0.3, 0.1])
    track = roll_track([-0.025, -0.025, 0.03, 0.03, 0.115, 0.115], clock)
    assert text_of(plate, track) == ["stop and go on"]


def test_a_turn_back_in_mid_line_invents_nothing() -> None:
    plate = Plate().text("stop and go on")
    track = roll_track([-0.025, -0.025, 0.05, 0.02, 0.115, 0.115], [0, 0.1, 0.4, 0.55, 0.9, 1.0])
    cells, pipeline = read(scan(plate, track), track)
    (line,) = pipeline.text()
    assert len(line) == len("stop and go on")
    assert all(a in (b, UNREADABLE) for a, b in zip(line, "stop and go on", strict=True))
    assert sum(not c.readable for c in cells) <= 2
    assert pipeline.counts.repeated_cells > 5


@pytest.mark.parametrize("x", [0.012, 0.0135, 0.015, 0.0165])
def test_beginning_and_ending_in_mid_cell(x: float) -> None:
    """The view's border lies anywhere within a cell where the roll begins and ends."""
    text = "stop and go on"
    plate = Plate().text(text)
    for track in (
        roll_track([x, x, 0.115, 0.115], [0.0, 0.1, 0.45, 0.55]),
        roll_track([-0.025, -0.025, 0.03 + x, 0.03 + x], [0.0, 0.1, 0.35, 0.45]),
    ):
        cells, _ = read(scan(plate, track), track)
        truth = to_masks(text)
        numbers = [round((c.position[0] - DOT / 2) / CELL) for c in cells]
        assert all(c.mask == truth[n] for c, n in zip(cells, numbers, strict=True) if c.readable)
        assert sum(c.readable for c in cells) >= 8


@pytest.mark.parametrize("y_mm", [-11.0, -8.0, 7.0, 10.0])
def test_lines_cut_by_the_border_of_the_view(y_mm: float) -> None:
    plate = Plate().text("half cells")
    track = over(plate, y=y_mm * 1e-3)
    truth = to_masks("half cells")
    for cell in read(scan(plate, track), track)[0]:
        n = round((cell.position[0] - DOT / 2) / CELL)
        assert not cell.readable or cell.mask == truth[n]


def test_a_line_that_breaks_off_goes_on_in_its_own_row() -> None:
    """Relief over a few cells ends a line; what comes after it is no line of its own."""
    text = "first half second"
    plate = Plate().text(text, y0=5e-3).text("the lower line", y0=-5e-3)
    rng = np.random.default_rng(4)
    begin, end = (n * CELL - (CELL - DOT) / 2 for n in (6, 10))
    plate.dots = [d for d in plate.dots if d[1] < 0 or not begin < d[0] < end]
    spots = rng.uniform([begin + 1e-3, 2e-3], [end - 1e-3, 8e-3], (60, 2))
    plate.dots += [(x, y, *RING, 200) for x, y in spots]
    track = over(plate)
    upper, lower = read(scan(plate, track), track)[1].text()
    assert lower == "the lower line"
    assert (upper[:6], upper[-6:], len(upper)) == (text[:6], text[-6:], len(text))
    assert set(upper[6:10]) == {UNREADABLE}
