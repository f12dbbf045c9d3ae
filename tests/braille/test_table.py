"""Grade 1 table: both directions, signs, doubts."""

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from braille.writing import to_masks
from roller_braille.table import (
    DIGITS,
    LETTERS,
    NUMBER_SIGN,
    UNREADABLE,
    Decoder,
    pattern,
)

words = st.text("abcdefghijklmnopqrstuvwxyzABCXYZ0123456789.,;:!-'", min_size=1, max_size=8)
texts = st.lists(words, min_size=1, max_size=5).map(" ".join)


def to_text(masks: list[int]) -> str:
    """What cells say; one without a meaning as its pattern."""
    decoder = Decoder()
    read = [(m, decoder.read(m)) for m in masks]
    return "".join(pattern(m) if c is None else c for m, c in read)


@settings(max_examples=1000)
@given(text=texts)
@example(text="AA0a")
@example(text="AB1AB 2ab Ab1")
def test_what_is_written_is_read(text: str) -> None:
    assert to_text(to_masks(text)) == text


def test_letters_are_the_braille_alphabet() -> None:
    alphabet = "⠁⠃⠉⠙⠑⠋⠛⠓⠊⠚⠅⠇⠍⠝⠕⠏⠟⠗⠎⠞⠥⠧⠺⠭⠽⠵"
    assert "".join(pattern(LETTERS[c]) for c in "abcdefghijklmnopqrstuvwxyz") == alphabet
    assert len(set(LETTERS.values())) == 26
    assert [DIGITS[c] for c in "1234567890"] == [LETTERS[c] for c in "abcdefghij"]


@pytest.mark.parametrize(
    ("text", "cells"),
    [
        ("Hello 123", "⠠⠓⠑⠇⠇⠕⠀⠼⠁⠃⠉"),
        ("4b 4k", "⠼⠙⠰⠃⠀⠼⠙⠅"),
        ("NASA a", "⠠⠠⠝⠁⠎⠁⠀⠁"),
        ("3.14, 2", "⠼⠉⠲⠁⠙⠂⠀⠼⠃"),
        ('"why?"', "⠦⠺⠓⠽⠦⠴"),
    ],
)
def test_known_lines(text: str, cells: str) -> None:
    assert "".join(map(pattern, to_masks(text))) == cells
    assert to_text([ord(c) - 0x2800 for c in cells]) == text


def test_no_cell_no_guess() -> None:
    assert to_text([0b111111, LETTERS["b"]]) == pattern(0b111111) + "b"
    assert UNREADABLE == "\ufffd"


@pytest.mark.parametrize(
    ("cells", "text"), [("⠠⠠⠏⠉⠃⠠⠄⠎", "PCBs"), ("⠠⠠⠏⠉⠠⠄⠃ ⠁", "PCb a"), ("⠄⠠⠞⠊⠎", "'Tis")]
)
def test_capitals_end_within_a_word(cells: str, text: str) -> None:
    assert to_text([ord(c) - 0x2800 for c in cells.replace(" ", "⠀")]) == text


@pytest.mark.parametrize("prefix", "⠈⠐⠘⠨⠸")
def test_behind_a_prefix_a_cell_is_no_letter(prefix: str) -> None:
    """As the s of a dollar sign; what comes then is read again."""
    assert to_text([ord(c) - 0x2800 for c in f"{prefix}⠎⠼⠃"]) == f"{prefix}⠎2"
    assert to_text([ord(c) - 0x2800 for c in f"⠁{prefix}⠀⠁"]) == f"a{prefix} a"


@pytest.mark.parametrize("cell", "⠤⠦⠴⠂")
def test_behind_a_capital_sign_only_letters_are_read(cell: str) -> None:
    """With it a hyphen is a dash."""
    assert to_text([ord(c) - 0x2800 for c in f"⠁⠠{cell}⠃"]) == f"a{cell}b"


def test_after_an_unreadable_cell_that_may_be_a_number_sign_nothing_is_guessed() -> None:
    decoder = Decoder()
    decoder.skip(NUMBER_SIGN, 0b111110)
    assert decoder.read(LETTERS["b"]) is None
    assert decoder.read(0) == " "
    assert decoder.read(LETTERS["b"]) == "b"


def test_an_unreadable_digit_leaves_the_rest_of_the_number_open() -> None:
    decoder = Decoder()
    decoder.read(NUMBER_SIGN)
    decoder.skip(DIGITS["7"], 0b110111)
    assert decoder.read(DIGITS["2"]) is None
    assert decoder.read(LETTERS["k"]) == "k"


def test_an_unreadable_letter_that_can_be_no_sign_leaves_the_rest_readable() -> None:
    decoder = Decoder()
    decoder.skip(LETTERS["q"], 0b011111)
    assert decoder.read(LETTERS["b"]) == "b"
