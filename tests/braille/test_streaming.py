"""Cells come as they pass, live."""

import numpy as np
import pytest

from braille.synthetic import CAMERA, SETTINGS, SPACING, Plate, over, scan
from roller_braille.cells import Cell
from roller_braille.pipeline import BraillePipeline
from roller_braille.reader_settings import BrailleSettings
from roller_braille.table import UNREADABLE


def stream(
    plate: Plate, speed: float, noise: int = 20_000
) -> tuple[list[tuple[Cell, float]], BraillePipeline]:
    """Cells with their age in seconds, events coming by the millisecond, and the pipeline."""
    track = over(plate, speed)
    events = scan(plate, track, noise=noise)
    pipeline = BraillePipeline(SETTINGS, CAMERA, track)
    found, begin = [], 0
    for now_ns in range(track.start_ns, track.end_ns, 1_000_000):
        end = int(np.searchsorted(events.t_ns, now_ns))
        pipeline.add_events(events[begin:end])
        begin = end
        found += [(cell, (now_ns - cell.stamp_ns) * 1e-9) for cell in pipeline.results()]
    return found, pipeline


@pytest.mark.parametrize("speed", [0.05, 0.1, 0.3, 0.5])
def test_cells_come_as_they_pass(speed: float) -> None:
    """Spaces too: none waits for the cell after it to be read."""
    text = "the quick brown fox jumps over it"
    found, pipeline = stream(Plate().text(text), speed, noise=60_000)
    ages_s = [age for _, age in found]
    assert pipeline.text() == [text]
    assert max(ages_s[3:]) < 0.05
    # Where the sensor is fast, a line's first cells wait until it is known for one.
    assert max(ages_s[:3]) < (0.05 if speed < 0.2 else 0.04 + 0.02 / speed)
    assert pipeline.counts.repeated_cells == 0


def test_first_cells_of_two_lines_do_not_wait_for_those_after_them() -> None:
    plate = Plate().text("quick jazz", y0=5e-3).text("lazy dog", y0=-5e-3)
    found, pipeline = stream(plate, 0.05)
    assert pipeline.text() == ["quick jazz", "lazy dog"]
    assert len({(cell.line, cell.column) for cell, _ in found}) == len(found) == 18
    assert max(age for _, age in found) < 0.05


@pytest.mark.parametrize("worn", [True, False])
def test_first_cells_wait_where_what_comes_next_is_in_doubt(worn: bool) -> None:
    """A dot of the third cell of which half is missing, or that is faint."""
    plate = Plate().text("the quick fox")
    n = next(i for i, dot in enumerate(plate.dots) if dot[0] > 2 * SPACING.cell_pitch_m - 1e-4)
    x, y, a, b, count = plate.dots[n]
    plate.dots[n] = (x, y, a, b / 2, count // 2) if worn else (x, y, a, b, count // 4)
    found, pipeline = stream(plate, 0.05)
    assert pipeline.text() == [f"th{UNREADABLE} quick fox"]
    ages_s = {cell.column: age for cell, age in found}
    assert ages_s[0] > 0.2
    assert max(age for column, age in ages_s.items() if column > 4) < 0.05


@pytest.mark.parametrize("indent_m", [0.0, 3e-3, 20e-3])
def test_lines_in_view_together_can_come_as_they_pass(indent_m: float) -> None:
    """Not the lower one seconds after the upper; which is which line and column tell."""
    plate = Plate().text("the upper line", y0=5e-3).text("low one", x0=indent_m, y0=-5e-3)
    track = over(plate)
    events = scan(plate, track)
    chunks = round((events.t_ns[-1] - events.t_ns[0]) / 5e6)
    waits: dict[str, list[float]] = {}
    found: dict[str, list[Cell]] = {}
    for order in ("reading", "seen"):
        pipeline = BraillePipeline(BrailleSettings.create({"line_order": order}), CAMERA, track)
        found[order], waits[order] = [], []
        for part in np.array_split(np.arange(len(events)), chunks):
            pipeline.add_events(events[part])
            for cell in pipeline.results():
                found[order].append(cell)
                if cell.line == 1 and cell.column > 2:
                    waits[order].append((events.t_ns[part[-1]] - cell.stamp_ns) * 1e-9)
        found[order] += pipeline.results(flush=True)
        assert pipeline.text() == ["the upper line", "low one"]
    places = [(cell.line, cell.column) for cell in found["reading"]]
    assert places == sorted(places)
    as_seen = [(cell.line, cell.column) for cell in found["seen"]]
    assert as_seen != places
    assert sorted(as_seen) == places
    for line in (0, 1):
        columns = [column for n, column in as_seen if n == line]
        assert columns == sorted(columns)
    assert [c.mask for c in sorted(found["seen"], key=lambda c: (c.line, c.column))] == [
        c.mask for c in found["reading"]
    ]
    assert max(waits["seen"]) < 0.05
    # In reading order they wait for a line of 87 mm at 0.3 m/s.
    assert not waits["reading"] or min(waits["reading"]) > 0.05


def test_specks_beside_a_line_do_not_keep_its_mosaic() -> None:
    plate = Plate().text("the quick brown fox jumps over it", events=4000)
    plate.dots += [(x, 8e-3, 0.0, 2 * np.pi, 100) for x in np.arange(0.01, 0.19, 0.012)]
    track = over(plate)
    events = scan(plate, track)
    pipeline = BraillePipeline(SETTINGS, CAMERA, track)
    kept_m = []
    for begin in range(0, len(events), 5000):
        pipeline.add_events(events[begin : begin + 5000])
        list(pipeline.results())
        if (reader := pipeline._reader) is not None:
            kept_m.append((reader.strip.exposure.seen[1] - reader.strip.first) * reader.strip.px_m)
    assert pipeline.text() == ["the quick brown fox jumps over i"]
    assert max(kept_m) < 0.1
