"""Text from the cells that a graph published stands as the replay's does."""

from braille.synthetic import SPACING, Plate, over, read, scan
from roller_inspect.results.recorded import _lines


def test_lines_lie_as_on_the_page() -> None:
    plate = Plate().text("the title", x0=4 * SPACING.cell_pitch_m, y0=5e-3)
    plate.text("lower line is long", y0=-5e-3)
    track = over(plate)
    cells, pipeline = read(scan(plate, track), track, chunks=100)
    numbers = [line.number for line in pipeline.lines()]
    assert numbers == [1, 0]
    assert _lines(cells) == pipeline.lines()
    assert [line.number for line in _lines(cells)] == numbers
