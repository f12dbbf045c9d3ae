"""The reader over plates of the virtual cell, with its noise, light and clocks."""

from typing import Any

import numpy as np
import pytest

from braille.synthetic import read
from roller_braille.cells import Cell
from roller_braille.pipeline import BraillePipeline
from roller_evaluation.braille import CONDITIONS
from roller_sim.truth import Truth
from simulated_scans import Scans

#: Small enough to be quick, large enough for a line: pixels of 1.5 times the camera's.
CAMERA = {"width": 280, "height": 166, "focal_px": 711.0}
#: Where the light falls at a slant, contrast is strongest: faint dots need all of the view.
WIDE = CAMERA | {"width": 400}
#: As fine as the camera's own pixels, where contrast is weakest or spots are as fine.
FINE = {"width": 320, "height": 250}
TEXT = "dfhj 42"


def read_plate(
    scans: Scans, text: str = TEXT, speed: float = 0.3, **settings: Any
) -> tuple[list[Cell], BraillePipeline, Truth]:
    """Read a simulated plate, its events coming by the 10 ms or so."""
    values: dict[str, Any] = {"camera": CAMERA, **settings}
    scene = {"text": text, "step_mm": 0.03, "margin_mm": 3.0}
    values["scene"] = scene | settings.get("scene", {})
    scan = scans.scan("braille", speed=speed, **values)
    cells, pipeline = read(scan.events, scan.track, 50, scan.camera)
    # Where the paper's image of all events gives a cell at all, it gives the same.
    for b in read(scan.events, scan.track, 50, scan.camera, polarity="both")[0]:
        here = [a for a in cells if np.linalg.norm(a.position - b.position) < 2e-3]
        assert all(a.mask == b.mask for a in here if a.readable and b.readable)
    return cells, pipeline, scan.truth


def check_places(cells: list[Cell], truth: Truth, speed: float) -> None:
    """Where the cells lie, but for what late stamps carry them along the roll."""
    late = speed * truth.event_delay_ns * 1e-9
    off = np.array([c.position[:2] for c in cells]) - [(m.x + late, m.y) for m in truth.marks]
    # Pixels fire once the light has changed by their threshold: a little behind each edge.
    assert np.abs(off.mean(axis=0) - (1e-4, 0.0)).max() < 1.2e-4
    assert np.std(off, axis=0).max() < 7e-5  # the one against the other


@pytest.mark.parametrize("speed", [0.1, 0.5])
def test_a_plate_is_read(scans: Scans, speed: float) -> None:
    cells, pipeline, truth = read_plate(scans, speed=speed)
    assert pipeline.text() == [TEXT]
    assert [c.mask for c in cells] == [m.mask for m in truth.marks]
    assert min(c.confidence for c in cells) > 0.6
    check_places(cells, truth, speed)
    assert np.ptp([c.position[2] for c in cells]) < 1e-5


@pytest.mark.parametrize("speckle", [0.03, 0.08])
def test_cells_before_the_second_dot_lie_as_all_others(scans: Scans, speckle: float) -> None:
    light = {"speckle": speckle}
    cells, _, truth = read_plate(scans, "a cab", light=light, camera=FINE)
    assert [c.mask for c in cells] == [m.mask for m in truth.marks]
    check_places(cells, truth, 0.3)


def test_weak_contrast_and_much_noise(scans: Scans) -> None:
    sensor = {"threshold": 0.35, "background_hz": 3.0, "hot_share": 1e-3}
    _, pipeline, _ = read_plate(scans, "dfhj", sensor=sensor, camera={"width": 600, "height": 230})
    assert pipeline.text() == ["dfhj"]
    assert pipeline.counts.hot_pixels > 0


def test_at_low_contrast_nothing_is_misread(scans: Scans) -> None:
    """Dots change the light by 0.26 to 0.34; a threshold above sees but traces of them."""
    cells, _, truth = read_plate(scans, "lazy dog", sensor={"threshold": 0.44}, camera=WIDE)
    for c in cells:
        nearest = min(truth.marks, key=lambda m: abs(m.x - c.position[0]))
        assert not c.readable or c.mask == nearest.mask


def test_half_the_contrast_is_read_in_a_light_that_shows_dots_well(scans: Scans) -> None:
    """Dots that change the light by 0.63 are still above a threshold of 0.5."""
    _, pipeline, _ = read_plate(scans, **CONDITIONS["strong light, half contrast"])
    assert pipeline.text() == [TEXT]


def test_a_turned_plate_is_read(scans: Scans) -> None:
    _, pipeline, _ = read_plate(scans, "lazy dog", scene={"turn_deg": 5.0})
    assert pipeline.text() == ["lazy dog"]


def test_a_coarse_coating_makes_no_other_letters(scans: Scans) -> None:
    """Speckle of 5 % for the default's 3 %: its events come from everywhere."""
    cells, _, truth = read_plate(scans, "quick jazz", light={"speckle": 0.05})
    readable = [c for c in cells if c.readable and c.mask]
    for c in readable:
        nearest = min(truth.marks, key=lambda m: abs(m.x - c.position[0]))
        assert c.mask == nearest.mask
    assert len(readable) >= 8


def test_a_printed_coating_hides_no_dots(scans: Scans) -> None:
    """Its spots give far more events than the dots, but as many ON as OFF."""
    cells, pipeline, truth = read_plate(scans, "dfhj", light={"speckle": 0.08}, camera=FINE)
    assert len(pipeline.lines()) == 1
    assert [c.mask for c in cells if c.readable] == [m.mask for m in truth.marks]


def test_text_is_read_under_a_printed_coating_of_coarse_grain(scans: Scans) -> None:
    """Spots of 0.2 mm leave a sixth of a dot's events of each other."""
    light = {"speckle": 0.08, "speckle_mm": 0.2}
    cells, pipeline, truth = read_plate(scans, "quick fox", light=light, camera=FINE)
    assert pipeline.text() == ["quick fox"]
    assert [c.mask for c in cells] == [m.mask for m in truth.marks]
    check_places(cells, truth, 0.3)


def test_a_printed_line_upside_down_that_ends_in_one_column_is_read(scans: Scans) -> None:
    """Of `ball` only right columns are seen; spots of the coating lie off these as well."""
    scene, light = {"turn_deg": 180.0}, {"speckle": 0.08}
    cells, pipeline, _ = read_plate(scans, "dog ball", scene=scene, light=light, camera=FINE)
    assert pipeline.text() == ["dog ball"]
    assert all(cell.readable for cell in cells)


@pytest.mark.parametrize(
    ("text", "degrees"), [("a a fox", 0.0), ("a a quick", 0.0), ("fox a a", 180.0)]
)
def test_a_printed_line_that_begins_with_few_dots_is_read_from_its_first(
    scans: Scans, text: str, degrees: float
) -> None:
    """Two dots begin no line; what lies before one is known once its pattern is."""
    scene, light = {"turn_deg": degrees}, {"speckle": 0.08}
    cells, pipeline, _ = read_plate(scans, text, scene=scene, light=light, camera=FINE)
    assert pipeline.text() == [text]
    assert all(cell.readable for cell in cells)


@pytest.mark.parametrize("speed", [0.1, 0.5])
def test_of_a_coating_before_a_line_no_cells_are_made_up(scans: Scans, speed: float) -> None:
    light, scene = {"speckle": 0.08}, {"margin_mm": 60.0}
    cells, pipeline, truth = read_plate(
        scans, "fox", speed=speed, scene=scene, light=light, camera=FINE
    )
    assert pipeline.text() == ["fox"]
    assert [c.mask for c in cells] == [m.mask for m in truth.marks]


@pytest.mark.parametrize("speckle", [0.05, 0.08])
@pytest.mark.parametrize("lands_mm", [0.0, 10.0])
def test_where_the_skin_does_not_touch_a_coating_does_not_show(
    scans: Scans, speckle: float, lands_mm: float
) -> None:
    """At the ends of the patch, and before the roller lands: neither says that there is none."""
    scene = {"text": "dfhj", "step_mm": 0.03, "margin_mm": 3.0 + lands_mm}
    light = {"speckle": speckle}
    scan = scans.scan("braille", speed=0.3, camera=FINE, scene=scene, light=light)
    events, height = scan.events, scan.camera.height
    touching = np.abs(events.y - height / 2) < 0.36 * height
    # A few of a coating's events are noise.
    lands_ns = events.t_ns[0] + lands_mm / 300.0 * 1e9
    touching &= (events.t_ns > lands_ns) | (np.arange(len(events)) % 100 == 0)
    cells, pipeline = read(events[touching], scan.track, 50, scan.camera)
    assert pipeline.text() == ["dfhj"]
    assert all(cell.readable for cell in cells)


@pytest.mark.parametrize("name", ["bumps", "sparse_sphere"])
def test_relief_gives_no_text(scans: Scans, name: str) -> None:
    scan = scans.scan(name, speed=0.5, camera=CAMERA, scene={"step_mm": 0.04})
    cells, pipeline = read(scan.events, scan.track, 50, scan.camera)
    assert (cells, pipeline.text()) == ([], [])
