"""The reader over plates of the virtual cell, with its noise, light and clocks."""

from __future__ import annotations

import numpy as np
import pytest

from roller_braille.cells import Cell
from roller_braille.pipeline import BraillePipeline
from roller_braille.reader_settings import BrailleSettings
from roller_core.codecs import encode
from roller_core.event_stream import EventStream
from roller_core.sensor_pose import SensorFrames
from roller_core.transforms import matrix_to_quaternion
from roller_evaluation.braille import CONDITIONS
from roller_sim.cell import Packet, PoseSample, VirtualCell
from roller_sim.cell_settings import VirtualCellSettings

#: Small enough to be quick, large enough for a line.
CAMERA = {"width": 420, "height": 250}
#: Where the light falls at a slant, contrast is strongest: faint dots need all of the view.
WIDE = {"width": 600, "height": 230}
TEXT = "dfhj 42"


def scan(
    settings: dict[str, object], **motion: object
) -> tuple[list[Cell], BraillePipeline, VirtualCell]:
    """Cells read from a simulated scan, driven as the node would."""
    values = {"camera": CAMERA, **settings, "motion": motion}
    cell = VirtualCell(VirtualCellSettings.create(values))
    frames = SensorFrames()
    fixed = cell.hand_eye
    frames.add_static(
        frames.moving, frames.sensor, fixed[:3, 3], matrix_to_quaternion(fixed[:3, :3])
    )
    stream = EventStream(cell.camera.width, cell.camera.height)
    pipeline = BraillePipeline(BrailleSettings.create({}), cell.camera, frames.track)
    cells: list[Cell] = []
    both = BraillePipeline(BrailleSettings.create({"polarity": "both"}), cell.camera, frames.track)
    for item in cell.run():
        if isinstance(item, Packet):
            payload = encode("mono", item.events, item.time_base_ns)
            size = cell.camera.width, cell.camera.height
            events = stream.push("mono", *size, item.seq, item.stamp_ns, item.time_base_ns, payload)
            pipeline.add_events(events)
            both.add_events(events)
        elif isinstance(item, PoseSample):
            frames.add(frames.base, frames.moving, item.stamp_ns, item.position, item.quaternion)
        cells += pipeline.results()
    cells += pipeline.results(flush=True)
    # Where the paper's image of all events gives a cell at all, it gives the same.
    for b in both.results(flush=True):
        here = [a for a in cells if np.linalg.norm(a.position - b.position) < 2e-3]
        assert all(a.mask == b.mask for a in here if a.readable and b.readable)
    return cells, pipeline, cell


def plate(text: str = TEXT, **more: object) -> dict[str, object]:
    """Settings of a Braille plate."""
    return {"scene": {"name": "braille", "text": text, "step_mm": 0.03, **more}}


@pytest.mark.parametrize("speed", [0.1, 0.5])
def test_a_plate_is_read(speed: float) -> None:
    cells, pipeline, cell = scan(plate(), speed=speed)
    assert pipeline.text() == [TEXT]
    marks = cell.truth.marks
    assert [c.mask for c in cells] == [m.mask for m in marks]
    assert min(c.confidence for c in cells) > 0.6
    # Latency and low pass of the pixels carry the events a little along the roll.
    off = np.array([c.position for c in cells]) - [(m.x, m.y, 0.0) for m in marks]
    assert np.abs(off[:, :2]).max() < 0.5e-3
    assert np.abs(off[:, 2]).max() < 0.5e-3


def test_a_plate_is_read_against_the_reading_direction() -> None:
    cells, pipeline, cell = scan(plate(), start_mm=75.0, end_mm=-12.0, speed=0.3)
    assert pipeline.text() == [TEXT]
    assert [c.mask for c in cells] == [m.mask for m in cell.truth.marks]


def test_weak_contrast_and_much_noise() -> None:
    sensor = {"threshold": 0.35, "background_hz": 3.0, "hot_share": 1e-3}
    _, pipeline, _ = scan({**plate(), "sensor": sensor, "camera": WIDE}, speed=0.3)
    assert pipeline.text() == [TEXT]
    assert pipeline.counts.hot_pixels > 0


@pytest.mark.parametrize(("threshold", "share"), [(0.3, 0.9), (0.44, 0.0)])
def test_at_low_contrast_nothing_is_misread(threshold: float, share: float) -> None:
    """Dots change the light by 0.26 to 0.34; a threshold above sees but traces of them."""
    sensor = {"sensor": {"threshold": threshold}, "camera": WIDE}
    cells, _, cell = scan({**plate("lazy dog"), **sensor}, speed=0.3)
    marks = cell.truth.marks
    readable = [c for c in cells if c.readable]
    for c in readable:
        nearest = min(marks, key=lambda m: abs(m.x - c.position[0]))
        assert c.mask == nearest.mask
    assert len(readable) >= share * len(marks)


@pytest.mark.parametrize("condition", ["strong light, half contrast", "strong light, 10 × noise"])
def test_a_plate_is_read_in_a_light_that_shows_dots_well(condition: str) -> None:
    """Dots that change the light by 0.63 are still above a threshold of 0.5."""
    _, pipeline, _ = scan({**plate(), **CONDITIONS[condition]}, speed=0.3)
    assert pipeline.text() == [TEXT]


@pytest.mark.parametrize("turn_deg", [5.0, 180.0])
def test_a_turned_plate_is_read(turn_deg: float) -> None:
    _, pipeline, _ = scan(plate("lazy dog", turn_deg=turn_deg), speed=0.3)
    assert pipeline.text() == ["lazy dog"]


@pytest.mark.parametrize("name", ["bumps", "sparse_sphere"])
def test_relief_gives_no_text(name: str) -> None:
    cells, pipeline, _ = scan({"scene": {"name": name, "step_mm": 0.04}}, speed=0.5)
    assert (cells, pipeline.text()) == ([], [])
