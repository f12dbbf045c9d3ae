"""Lines of cells as print: own table, liblouis where it is, and Braille Ready Format."""

import importlib
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from braille.synthetic import Plate, over, read, scan
from roller_braille import table, translation
from roller_braille.text_files import to_brf
from roller_braille.translation import LineCell, TranslationError, line_reader

needs_liblouis = pytest.mark.skipif(
    importlib.util.find_spec("louis") is None and not translation._SYSTEM.exists(),
    reason="liblouis is not installed: apt install python3-louis",
)


def cells(patterns: str, doubtful: tuple[int, ...] = ()) -> list[LineCell]:
    return [
        LineCell(ord(c) - 0x2800, 0b011111 if k in doubtful else translation.ALL_DOTS)
        for k, c in enumerate(patterns)
    ]


def test_grade_1_knows_the_cell_of_each_character() -> None:
    reading = line_reader("grade1")(cells("⠠⠓⠊⠀⠼⠁⠃"))
    assert reading.text == "Hi 12"
    assert reading.cells == (1, 2, 3, 5, 6)


def test_grade_1_keeps_what_it_does_not_know() -> None:
    reading = line_reader("grade1")(cells("⠁⠿⠃⠉", doubtful=(2,)))
    assert reading.text == "a⠿�c"
    assert reading.cells == (0, 1, 2, 3)


@needs_liblouis
@pytest.mark.parametrize(
    ("code", "patterns", "text", "origin"),
    [
        ("ueb1", "⠠⠓⠊⠀⠼⠁⠃⠲", "Hi 12.", (0, 2, 3, 4, 6, 7)),
        ("ueb2", "⠃⠀⠮⠀⠉⠁⠞", "but the cat", (0, 0, 0, 1, 2, 2, 2, 3, 4, 5, 6)),
        ("ueb2", "⠠⠠⠞⠓⠊⠎", "THIS", (0, 3, 4, 5)),
        ("ueb2", "", "", ()),
    ],
)
def test_english_braille(code: str, patterns: str, text: str, origin: tuple[int, ...]) -> None:
    reading = line_reader(code)(cells(patterns))
    assert (reading.text, reading.cells) == (text, origin)


@needs_liblouis
def test_a_word_with_a_doubtful_cell_is_not_read() -> None:
    """A b alone is 'but'; with an uncertain neighbour it could be anything."""
    reading = line_reader("ueb2")(cells("⠮⠀⠃⠁⠀⠉⠁⠞", doubtful=(3,)))
    assert reading.text == "the ⠃� cat"
    assert reading.cells == (0, 0, 0, 1, 2, 3, 4, 5, 6, 7)
    only = line_reader("ueb2")(cells("⠃", doubtful=(0,)))
    assert only.text == table.UNREADABLE


@needs_liblouis
def test_a_cell_without_a_meaning_stands_as_its_pattern() -> None:
    reading = line_reader("ueb1")(cells("⠁⠀⠿"))
    assert reading.text == "a ⠿"
    assert reading.cells == (0, 1, 2)


@needs_liblouis
@given(st.lists(st.integers(0, 63), max_size=20), st.data())
def test_every_character_has_its_cell(masks: list[int], data: st.DataObject) -> None:
    line = [LineCell(m, data.draw(st.sampled_from([63, 63, 63, 0]))) for m in masks]
    for code in ("grade1", "ueb1", "ueb2"):
        reading = line_reader(code)(line)
        assert len(reading.text) == len(reading.cells)
        assert all(0 <= k < len(line) for k in reading.cells)
        assert list(reading.cells) == sorted(reading.cells)
        for k, cell in enumerate(line):
            if not cell.readable:
                assert reading.text[reading.cells.index(k)] == table.UNREADABLE


@needs_liblouis
@pytest.mark.parametrize("text", ["the quick brown fox", "Hello 123, but why?", "knowledge"])
def test_contracted_text_comes_back(text: str) -> None:
    louis = translation._liblouis()
    patterns = louis.translateString(["unicode.dis", "en-ueb-g2.ctb"], text)
    assert line_reader("ueb2")(cells(patterns)).text == text


def test_without_liblouis_it_is_said(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def missing(name: str) -> None:
        raise ImportError(name)

    monkeypatch.setattr(translation.importlib, "import_module", missing)
    monkeypatch.setattr(translation, "_SYSTEM", tmp_path / "none.py")
    translation._liblouis.cache_clear()
    try:
        with pytest.raises(TranslationError, match="install the Debian package python3-louis"):
            line_reader("ueb2")
    finally:
        translation._liblouis.cache_clear()


@needs_liblouis
def test_a_plate_in_contracted_braille() -> None:
    plate = Plate().text("b cat")
    track = over(plate)
    found, pipeline = read(scan(plate, track), track, code="ueb2")
    assert pipeline.text() == ["but cat"]
    assert [c.character for c in found] == ["b", " ", "c", "a", "t"]
    assert all(c.readable for c in found)


def test_brf_breaks_lines_at_spaces_and_pages_after_25() -> None:
    line = [1, 3, 9, 0] * 11
    written = to_brf([line] * 26)
    assert written.startswith("ABC " * 9 + "ABC\r\nABC\r\n")
    assert written.count("\f") == 2
    assert max(len(row) for row in written.replace("\f", "").split("\r\n")) <= 40
    assert written.replace("\f", "").split() == ["ABC"] * 11 * 26


@needs_liblouis
def test_brf_is_north_american_ascii() -> None:
    louis = translation._liblouis()
    for mask in range(64):
        ascii_form = to_brf([[mask]]).rstrip("\r\n") or " "
        assert louis.charToDots(["en-us-brf.dis"], ascii_form)[0] in (
            chr(0x8000 + mask),
            chr(0x2800 + mask),
        )
