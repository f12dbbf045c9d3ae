"""What a later pass reads of a line that an earlier one has seen."""

import json

import pytest

from braille.synthetic import (
    CAMERA,
    SPACING,
    START_NS,
    Plate,
    over,
    read,
    roll_track,
    scan,
    text_of,
)
from roller_braille.braille_stage import BrailleParameters, BrailleStage, CellMarkers
from roller_braille.cells import Cell
from roller_braille.pipeline import BraillePipeline
from roller_braille.table import UNREADABLE
from roller_braille.text_files import cells_to_json
from roller_core.events import EventArray
from roller_core.pose_track import PoseTrack

TURN_NS = START_NS + 650_000_000


def worn(plate: Plate, *columns: int) -> Plate:
    """A plate of one line with half a dot of some cells missing."""
    dots = list(plate.dots)
    for column in columns:
        begin = column * SPACING.cell_pitch_m - 1e-4
        n = next(i for i, dot in enumerate(dots) if dot[0] > begin)
        x, y, a, b, count = dots[n]
        dots[n] = (x, y, a, b / 2, count // 2)
    return Plate(dots)


def there_and_back(first: Plate, second: Plate) -> tuple[PoseTrack, EventArray]:
    """A roll over one plate, and back over another in its place."""
    end = max(dot[0] for dot in first.dots) + 0.025
    track = roll_track([-0.025, -0.025, end, end, -0.025], [0.0, 0.1, 0.6, 0.7, 1.2])
    there, back = scan(first, track), scan(second, track)
    parts = there[there.t_ns < TURN_NS], back[back.t_ns >= TURN_NS]
    return track, EventArray.concatenate(parts)


def twice(first: Plate, second: Plate) -> tuple[list[Cell], BraillePipeline]:
    track, events = there_and_back(first, second)
    return read(events, track)


def test_a_cell_that_only_the_second_pass_reads_is_given_again() -> None:
    plate = Plate().text("the quick fox")
    cells, pipeline = twice(worn(plate, 4), plate)
    assert pipeline.text() == ["the quick fox"]
    assert [(c.column, c.readable) for c in cells if c.column == 4] == [(4, False), (4, True)]
    again = cells[-1]
    assert (again.line, again.column, again.character, len(cells)) == (0, 4, "q", 14)
    counts = pipeline.counts
    assert (counts.unreadable_cells, counts.repeated_cells, counts.reread_cells) == (1, 13, 1)
    data = json.loads(json.dumps(cells_to_json(cells, pipeline.lines(), "grade1")))
    assert [c["character"] for c in data["cells"]] == list("the quick fox")


def test_a_cell_that_only_the_first_pass_reads_stays() -> None:
    plate = Plate().text("the quick fox")
    cells, pipeline = twice(plate, worn(plate, 4, 6))
    assert pipeline.text() == ["the quick fox"]
    assert (len(cells), pipeline.counts.reread_cells) == (13, 0)


def test_passes_that_are_sure_of_different_dots_settle_nothing() -> None:
    """A u of which a dot is worn, and a plain p in its place."""
    first, second = worn(Plate().text("the quick fox"), 5), Plate().text("the qpick fox")
    cells, pipeline = twice(first, second)
    assert pipeline.text() == [f"the q{UNREADABLE}ick fox"]
    assert len(cells) == 13


@pytest.mark.parametrize(
    ("text", "once"),
    [("so No xyz", f"so {UNREADABLE}no xyz"), ("on 12 xyz", f"on {UNREADABLE}⠁⠃ xyz")],
)
def test_what_hangs_on_a_sign_is_given_again_with_it(text: str, once: str) -> None:
    """Something lies between the dots of the sign when it is seen first."""
    plate = Plate().text(text)
    track = over(plate)
    x, y = 3 * SPACING.cell_pitch_m + SPACING.dot_pitch_m / 2, SPACING.dot_pitch_m / 2
    spoilt = Plate([*plate.dots, (x, y, 0.0, 6.28, 1600)])
    assert text_of(spoilt, track) == [once]
    cells, pipeline = twice(spoilt, plate)
    assert pipeline.text() == [text]
    newest = {c.column: c.character for c in cells}
    assert "".join(newest[column] for column in sorted(newest)) == text
    assert {3, 4} <= {c.column for c in cells[len(newest) :]} <= {3, 4, 5}


def test_its_markers_take_the_place_of_those_shown() -> None:
    plate = Plate().text("the quick fox")
    track, events = there_and_back(worn(plate, 4), plate)
    stage = BrailleStage(BrailleParameters.create({}))
    stage.take_poses(track)
    stage.take_camera(CAMERA)
    stage.take_events(events)
    outputs = [o.data for flush in (False, True) for r in stage.results(flush) for o in r.outputs]
    shown = [m for m in outputs if isinstance(m, CellMarkers)]
    assert [m.number for m in shown] == [*range(1, 14), 5]
    assert [m.again for m in shown] == [False] * 13 + [True]
