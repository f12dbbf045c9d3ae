"""The reader over synthetic rings: every letter, every direction, and what it must not read."""

import numpy as np
import pytest

from braille.synthetic import (
    CAMERA,
    SETTINGS,
    SPACING,
    START_NS,
    Plate,
    over,
    read,
    roll_track,
    scan,
    text_of,
)
from braille.writing import to_masks
from roller_braille.lines import LineReader
from roller_braille.pipeline import BraillePipeline
from roller_braille.reader_settings import Spacing
from roller_braille.table import LETTERS, UNREADABLE
from roller_core.events import EventArray
from roller_core.pose_track import PoseTrack

ALPHABET = "abcdefghijklmnopqrstuvwxyz"


@pytest.mark.parametrize("back", [False, True])
def test_every_letter_both_ways(back: bool) -> None:
    plate = Plate().text(ALPHABET)
    track = over(plate, back=back)
    cells, pipeline = read(scan(plate, track), track)
    assert pipeline.text() == [ALPHABET]
    assert [c.mask for c in cells] == [LETTERS[c] for c in ALPHABET]
    assert [c.column for c in cells] == list(range(26))
    assert all(c.readable and c.confidence > 0.6 for c in cells)
    pitch = np.diff([c.position for c in cells], axis=0)
    np.testing.assert_allclose(pitch.mean(axis=0), [SPACING.cell_pitch_m, 0, 0], atol=5e-5)
    expected = [SPACING.dot_pitch_m / 2, 0, 0]
    np.testing.assert_allclose(cells[0].position, expected, atol=2e-4)
    np.testing.assert_allclose(cells[0].dot_positions[0], [0, SPACING.dot_pitch_m, 0], atol=2e-4)


@pytest.mark.parametrize(("speed", "p"), [(0.05, 1), (0.5, 0)])
def test_asymmetric_letters_at_any_speed_and_polarity(speed: float, p: int) -> None:
    plate = Plate().text("dfhj jhfd")
    assert text_of(plate, over(plate, speed), p=p) == ["dfhj jhfd"]


def test_capitals_numbers_and_signs() -> None:
    plate = Plate().text("No 42, ok?")
    track = over(plate)
    cells, pipeline = read(scan(plate, track), track)
    assert pipeline.text() == ["No 42, ok?"]
    assert (cells[0].character, cells[0].readable, cells[0].pattern) == ("", True, "⠠")
    assert cells[3].character == " "
    # Nothing fires over a space; it was seen at some time all the same.
    assert all(track.start_ns < c.stamp_ns <= track.end_ns for c in cells)


def test_a_cell_read_before_it_leaves_the_view_is_as_sure() -> None:
    plate = Plate().text("as sure as that")
    track = over(plate)
    events = scan(plate, track, noise=20_000)
    soon, late = (read(events, track, read_at_m=at)[0] for at in (0.006, 0.0125))
    assert [c.mask for c in soon] == [c.mask for c in late]
    assert min(c.confidence for c in soon) > 0.6


def test_results_do_not_depend_on_arrival() -> None:
    plate = Plate().text("same at any pace")
    track = over(plate)
    events = scan(plate, track, noise=20_000)
    whole, _ = read(events, track)
    split, _ = read(events, track, chunks=97)
    # Poses that come late, in small portions.
    late = PoseTrack()
    pipeline_cells = []
    pipeline = BraillePipeline(SETTINGS, CAMERA, late)
    pipeline.add_events(events)
    for k in range(0, len(track), 7):
        late.extend(*(a[k : k + 7] for a in (track.times_ns, track.positions, track.quaternions)))
        pipeline_cells += pipeline.results()
        needed = pipeline.needed_from_ns
        assert needed is None or late.start_ns <= needed
        if needed is not None:
            late.discard_before(needed)
    pipeline_cells += pipeline.results(flush=True)
    for cells in (split, pipeline_cells):
        assert [c.mask for c in cells] == [c.mask for c in whole]
        assert [c.stamp_ns for c in cells] == [c.stamp_ns for c in whole]
        np.testing.assert_array_equal(
            [c.dot_confidence for c in cells], [c.dot_confidence for c in whole]
        )
        np.testing.assert_array_equal([c.position for c in cells], [c.position for c in whole])


@pytest.mark.parametrize("side", [0.0, 0.5, 1.0, 1.5])
def test_half_a_dot_is_not_guessed(side: float) -> None:
    """A ring of which half is missing: at the right, above, left, below."""
    plate = Plate().text("abc lmn xyz")
    n = next(i for i, d in enumerate(plate.dots) if d[0] > 5 * SPACING.cell_pitch_m)
    x, y, _, _, count = plate.dots[n]
    plate.dots[n] = (x, y, (side + 0.5) * np.pi, (side + 1.5) * np.pi, count // 2)
    track = over(plate)
    cells, pipeline = read(scan(plate, track), track)
    assert pipeline.text() == [f"abc l{UNREADABLE}n xyz"]
    cell = cells[5]
    assert (cell.readable, cell.character) == (False, "")
    assert cell.confidence == min(cell.dot_confidence) < 0.4
    assert sum(c < 0.4 for c in cell.dot_confidence) == 1
    assert all(c.readable for c in cells if c is not cell)


def test_dots_without_a_meaning_appear_as_they_are() -> None:
    masks = to_masks("abc")
    plate = Plate().write([*masks, 0b111111, *masks])
    track = over(plate)
    cells, pipeline = read(scan(plate, track), track)
    assert pipeline.text() == ["abc⠿abc"]
    assert not cells[3].readable
    assert cells[3].confidence > 0.6


def test_noise_gives_no_text() -> None:
    track = over(Plate())
    for seed in range(3):
        cells, pipeline = read(scan(Plate(), track, seed, noise=150_000), track)
        assert (cells, pipeline.text()) == ([], [])


def test_text_under_noise() -> None:
    plate = Plate().text("under noise")
    assert text_of(plate, noise=400_000) == ["under noise"]


def test_standstill_gives_no_text() -> None:
    track = roll_track([0.0, 0.0], [0.0, 2.0])
    events = scan(Plate(), track, noise=50_000)
    cells, pipeline = read(events, track)
    assert cells == []
    assert pipeline.counts.batches == 0
    assert pipeline.counts.still_events == len(events)


def test_other_relief_gives_no_text() -> None:
    """Bars across the roll, a large ring, and dots strewn anywhere."""
    plate = Plate()
    for k, y in np.ndindex(9, 60):
        plate.dots.append((0.02 + 0.0031 * k, (y - 30) * 1.6e-4, 0.0, 2 * np.pi, 20))
    for angle in np.linspace(0, 2 * np.pi, 120):
        plate.dots.append((0.065 + 4e-3 * np.cos(angle), 4e-3 * np.sin(angle), 0.0, 6.28, 20))
    rng = np.random.default_rng(5)
    for _ in range(60):
        plate.dots.append((*rng.uniform([0.08, -5e-3], [0.14, 5e-3]), 0.0, 6.28, 400))
    track = over(plate)
    cells, pipeline = read(scan(plate, track), track)
    assert (cells, pipeline.text()) == ([], [])


def test_strewn_spots_are_seldom_tried_as_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    """Their lattices hold few of them: that is known before a line is measured."""
    tried: list[LineReader] = []

    def explained(line: LineReader) -> float:
        tried.append(line)
        return 0.0

    monkeypatch.setattr(LineReader, "explained", explained)
    rng = np.random.default_rng(5)
    plate = Plate([(*rng.uniform([0, -8e-3], [0.06, 8e-3]), 0.0, 6.28, 400) for _ in range(120)])
    assert text_of(plate) == []
    assert len(tried) < 45  # else 63


def bars(plate: Plate, x0: float, pitch: float) -> Plate:
    """Add six bars across the roll."""
    for k, y in np.ndindex(6, 60):
        plate.dots.append((x0 + pitch * k, (y - 30) * 1.6e-4, 0.0, 6.28, 60))
    return plate


def test_text_before_and_after_other_relief() -> None:
    plate = bars(Plate().text("first"), 0.036, 0.0017).text("second", x0=0.055)
    assert text_of(plate) == ["first", "second"]
    assert text_of(bars(Plate().text("ab"), 0.014, 0.0031)) == ["ab"]


def test_dust_around_the_text_changes_nothing() -> None:
    """Faint spots before, in and after a line, on its lattice and off it."""
    plate = Plate().text("dust dog")
    rng = np.random.default_rng(2)
    pitch, dot = SPACING.cell_pitch_m, SPACING.dot_pitch_m
    for n in (-3, -1, 4, 8, 9, 10, 11):
        plate.dots.append((n * pitch, dot * (n % 3 - 1), 0.0, 6.28, 20))
    for _ in range(40):
        plate.dots.append((*rng.uniform([-0.02, -0.008], [0.075, 0.008]), 0.0, 6.28, 15))
    assert text_of(plate) == ["dust dog"]


def test_a_second_pass_repeats_nothing() -> None:
    plate = Plate().text("there and back")
    a, b = -0.03, 0.12
    track = roll_track([a, a, b, b, a, a], [0.0, 0.1, 0.6, 0.65, 1.15, 1.2])
    cells, pipeline = read(scan(plate, track), track)
    assert pipeline.text() == ["there and back"]
    assert pipeline.counts.passes == 2
    assert pipeline.counts.repeated_cells == len(cells) == 14


def test_a_line_that_is_not_all_in_view_is_not_guessed() -> None:
    """Only the two lower rows of `rolls` are seen: they would make up other letters."""
    plate = Plate().text("rolls rolls")
    track = over(plate, y=-0.0085)
    cells, _ = read(scan(plate, track), track)
    assert not any(c.readable and c.mask for c in cells)


@pytest.mark.parametrize("back", [False, True])
def test_a_pass_that_ends_within_a_cell_does_not_guess_its_other_column(back: bool) -> None:
    """The left columns of o and x alone are k; the right ones of f and b would be a, or none."""
    masks = to_masks("the quick brown fox jumps over it")
    plate = Plate().write(masks)
    for place_m in np.arange(0.094, 0.106, 0.0015):
        a, b = (0.23, place_m) if back else (-0.025, place_m)
        seconds = abs(b - a) / 0.3
        track = roll_track([a, a, b, b], [0.0, 0.1, 0.1 + seconds, 0.2 + seconds])
        cells, _ = read(scan(plate, track), track)
        assert len(cells) > 15
        for cell in cells:
            n = round(cell.position[0] / SPACING.cell_pitch_m)
            assert not cell.readable or cell.mask == masks[n]


def test_missing_poses_are_counted_and_passed_over() -> None:
    plate = Plate().text("abc def ghi")
    full = over(plate)
    track = PoseTrack()
    middle = len(full) // 2
    for k in (*range(middle - 8), *range(middle + 8, len(full))):
        track.append(int(full.times_ns[k]), full.positions[k], full.quaternions[k])
    cells, pipeline = read(scan(plate, full), track)
    assert pipeline.counts.events_without_pose > 0
    assert pipeline.counts.passes == 2
    assert all(c.character in "abcdefghi " for c in cells if c.readable)


def test_events_before_and_after_all_poses() -> None:
    plate = Plate().text("abc def")
    full = over(plate)
    events = scan(plate, full)
    early = events[:100].shifted(-(10**9))
    late = events[-100:].shifted(10**9)
    cells, pipeline = read(EventArray.concatenate([early, events, late]), full)
    assert pipeline.text() == ["abc def"]
    assert pipeline.counts.events_without_pose == 200
    assert cells[-1].stamp_ns <= int(events.t_ns[-1])


def test_ramps_and_changing_speed() -> None:
    plate = Plate().text("ramp up")
    x = np.concatenate([[-0.025], np.cumsum([0.004] * 25) - 0.025])
    seconds = np.concatenate([[0.0], np.cumsum(np.linspace(0.08, 0.008, 25))])
    track = roll_track(x, seconds)
    assert text_of(plate, track) == ["ramp up"]


def test_pitches_that_are_a_little_off() -> None:
    plate = Plate().text("a few percent more")
    plate.dots = [(x * 1.025, y * 1.03, a, b, n) for x, y, a, b, n in plate.dots]
    assert text_of(plate) == ["a few percent more"]


@pytest.mark.parametrize(
    ("dot_mm", "cell_mm", "base_mm"),
    [(2.5, 6.0, 1.5), (2.5, 6.8, 1.6), (2.54, 6.5, 1.3), (2.34, 6.1, 1.2)],
)
def test_any_usual_spacing_is_found(
    dot_mm: float, cell_mm: float, base_mm: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    spacing = Spacing(dot_mm * 1e-3, cell_mm * 1e-3, 0.01, base_mm * 1e-3)
    monkeypatch.setattr("braille.synthetic.SPACING", spacing)
    plate = Plate().text("the quick fox")
    track = over(plate)
    cells, pipeline = read(scan(plate, track), track)
    assert pipeline.text() == ["the quick fox"]
    pitch = np.diff([c.position[0] for c in cells]).mean()
    assert pitch == pytest.approx(cell_mm * 1e-3, rel=0.01)


def test_depth_from_the_height_over_the_plate() -> None:
    plate = Plate().text("height")
    track = over(plate)
    settings = {"depth_source": "surface", "surface_z_m": 0.0, "depth_m": 0.0440}
    cells, pipeline = read(scan(plate, track), track, **settings)
    assert pipeline.text() == ["height"]
    assert abs(cells[0].position[2]) < 1e-6
    assert cells[0].stamp_ns > START_NS
