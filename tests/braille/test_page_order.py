"""Lines of text stand as they lie on the page, in whatever order they were seen."""

import json

import numpy as np
import pytest

from braille.synthetic import SPACING, Plate, over, read, roll_track, scan
from roller_braille.page_order import PageOrder
from roller_braille.text_files import cells_to_json
from roller_core.events import EventArray
from roller_core.pose_track import PoseTrack

CELL_M, DOT_M = SPACING.cell_pitch_m, SPACING.dot_pitch_m


def strips(plate: Plate, *rolls: tuple[float, float, float]) -> tuple[PoseTrack, EventArray]:
    """Rolls over a plate one after the other, each from x to x at a y."""
    track, events = PoseTrack(), []
    for k, (a, b, y) in enumerate(rolls):
        seconds = abs(b - a) / 0.3
        times = np.array([0.0, 0.1, 0.1 + seconds, 0.2 + seconds]) + 3.0 * k
        part = roll_track([a, a, b, b], times, y)
        track.extend(part.times_ns, part.positions, part.quaternions)
        events.append(scan(plate, part, seed=k))
    return track, EventArray.concatenate(events)


@pytest.mark.parametrize("order", ["seen", "reading"])
@pytest.mark.parametrize("indent", [0, 1, 2, 4])
def test_an_upper_line_that_is_indented_comes_first(indent: int, order: str) -> None:
    plate = Plate().text("the title", x0=indent * CELL_M, y0=5e-3)
    plate.text("lower line is long", y0=-5e-3)
    track = over(plate)
    cells, pipeline = read(scan(plate, track), track, chunks=100, line_order=order)
    assert pipeline.text() == ["the title", "lower line is long"]
    if order == "reading":
        assert [c.line for c in cells] == 9 * [0] + 18 * [1]


def test_a_lower_strip_that_is_rolled_first_comes_last() -> None:
    lines = ["first line", "second line", "third line", "fourth line"]
    plate = Plate()
    for k, line in enumerate(lines):
        plate.text(line, y0=15e-3 - 0.01 * k)
    track, events = strips(plate, (-0.025, 0.09, -0.01), (-0.025, 0.09, 0.01))
    cells, pipeline = read(events, track)
    assert pipeline.text() == lines
    # Numbers that were given stay; files join lines and cells by them.
    data = json.loads(json.dumps(cells_to_json(cells, pipeline.lines(), "grade1")))
    assert data["text"] == lines
    assert [line["line"] for line in data["lines"]] == [2, 3, 0, 1]
    for line in data["lines"]:
        own = [c["character"] for c in data["cells"] if c["line"] == line["line"]]
        assert "".join(own) == line["text"]
    assert list(pipeline.newest_lines(100)) == lines[::-1]


def test_of_a_row_the_left_part_comes_first() -> None:
    plate = Plate().text("the left part the right one")
    middle = 14 * CELL_M - 0.002
    right, left = (middle + 0.002, 0.19, 0.0), (-0.025, middle, 0.0)
    track, events = strips(plate, right, left)
    text = read(events, track)[1].text()
    assert "".join(text).replace(" ", "").startswith("theleftpart")


def cell(x: float, y: float) -> np.ndarray:
    """Dots of a cell in base, y being up the page."""
    return np.array([(x + c * DOT_M, y - r * DOT_M, 0.0) for c in (0, 1) for r in (0, 1, 2)])


def ordered(*lines: tuple[float, float, int], turn: float = 0.0) -> list[int]:
    """Order of lines from a place on, so many cells long, the cells of all by turns."""
    order = PageOrder(SPACING)
    c, s = np.cos(turn), np.sin(turn)
    rotation = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    for n in range(max(line[2] for line in lines)):
        for k, (x, y, count) in enumerate(lines):
            if n < count:
                order.take(k, cell(x + n * CELL_M, y) @ rotation.T)
    return order.lines


@pytest.mark.parametrize("turn", [0.0, 0.2, np.pi])
def test_lines_are_sorted_down_their_own_page(turn: float) -> None:
    assert ordered((0, 0, 9), (0, 0.01, 9), (0.012, 0.02, 3), turn=turn) == [2, 1, 0]


def test_a_second_column_follows_the_first() -> None:
    """Plates beside each other, seen at once."""
    left, right = [(0.0, 0.0, 8), (0.0, -0.01, 8)], [(0.15, 0.0, 8), (0.15, -0.01, 8)]
    assert ordered(*left, *right) == [0, 1, 2, 3]
    assert ordered(*right, *left) == [0, 1, 2, 3]
    assert ordered(*left, *right, (0.0, -0.02, 8)) == [0, 1, 4, 2, 3]


def test_plates_that_lie_otherwise_keep_their_order() -> None:
    order = PageOrder(SPACING)
    order.take(0, cell(0.0, 0.0))
    order.take(1, cell(0.0, 0.03)[::-1])
    assert order.lines == [0, 1]
