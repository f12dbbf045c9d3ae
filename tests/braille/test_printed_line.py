"""Where a line begins on a printed coating."""

import numpy as np
import pytest

from braille.synthetic import CAMERA, DOWN, SETTINGS, SPACING, Plate, over, scan
from braille.writing import to_masks
from roller_braille.dots import Dots
from roller_braille.kinds import Kind
from roller_braille.lattice import Lattice
from roller_braille.lines import LineReader
from roller_braille.recognise import Recogniser
from roller_braille.strip import Strip
from roller_braille.warp import Warp
from roller_core.passes import Pass

TEXT = "dfhj"


def read_from(cell: int, text: str = TEXT, begins_after: float = -np.inf) -> LineReader:
    """A line of text under a coating with its lattice laid from a cell of it on, and read."""
    plate = Plate().text(text)
    track = over(plate)
    start, warp = track.positions[0], Warp(SETTINGS, CAMERA, track)
    roll = Pass(DOWN, np.asarray(start), 1)
    strip = Strip(SETTINGS, warp.half_height_m)
    strip.ground.settle(printed=True)
    # A coating's spots give as many of either kind.
    events = scan(plate, track, noise=200_000)
    strip.add(events, warp.table, warp.knots(roll, track.start_ns, track.end_ns))
    x, y = np.array([dot[:2] for dot in plate.dots]).T
    order = np.argsort(x, kind="stable")
    dots = Dots(x[order] - start[0], -y[order], np.full(len(x), 300.0))
    pitch = SPACING.dot_pitch_m
    lattice = Lattice(-start[0], -pitch, SPACING.cell_pitch_m, pitch, pitch).moved(cell)
    view = (-warp.half_height_m, warp.half_height_m)
    line = LineReader(strip, Recogniser(SPACING), lattice, SPACING, Kind.OFF, 1, view)
    line.begins_after_m = begins_after - start[0]
    line.take(dots.where(line.holds(dots)))
    line.advance(strip.exposure.seen[1])
    return line


def test_a_line_is_read_from_its_first_dot_on() -> None:
    line = read_from(cell=0)
    assert line.accepted
    assert [cell.mask for cell in line.cells] == to_masks(TEXT)


@pytest.mark.parametrize("cell", [1, 3])
def test_cells_before_those_that_it_was_begun_with_are_read(cell: int) -> None:
    line = read_from(cell, text="ab dfhj quick")
    assert line.begun
    assert [seen.mask for seen in line.cells] == to_masks("ab dfhj quick")
    assert [seen.number for seen in line.cells] == list(range(len(line.cells)))


def test_what_another_line_has_is_not_read_again() -> None:
    text = "ab dfhj quick"
    x = 3 * SPACING.cell_pitch_m - 1e-3
    line = read_from(cell=3, text=text, begins_after=x)
    assert [seen.mask for seen in line.cells] == to_masks(text[3:])


def test_a_line_whose_first_place_is_empty_is_none() -> None:
    """What it was begun with was a coating's spot; where the text begins is looked for anew."""
    line = read_from(cell=-1)
    assert line.closed
    assert not line.accepted
    # Of what comes after that place nothing is given up.
    assert line.confirmed == pytest.approx(line.lattice.moved(1).begin, abs=1e-4)
