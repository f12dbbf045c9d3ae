"""What a fault says is one bounded line, whatever it quotes."""

import pytest

from roller_core.errors import RollerError, SettingsError, describe_fault_of_ours


@pytest.mark.parametrize(
    ("message", "said"),
    [
        ("two\nlines", "two lines"),
        ("a\x1b[31mb\x00\x07c", "a [31mb c"),
        ("frames 'ü  µ' -> '日本'", "frames 'ü  µ' -> '日本'"),
        ("'\udcff'", "'\udcff'"),
        ("x" * 600, "x" * 600),
    ],
)
def test_one_line(message: str, said: str) -> None:
    assert str(RollerError(message)) == said


def test_a_name_of_a_megabyte_is_cut_in_its_middle() -> None:
    said = str(SettingsError(f"transform {'A' * 10**6} -> base is not finite; left out"))
    assert len(said) < 610
    assert said.startswith("transform AAA")
    assert said.endswith("AAA -> base is not finite; left out")


def test_a_fault_of_ours_is_one_line_that_says_what_to_do() -> None:
    said = describe_fault_of_ours(ValueError("two\nlines"))
    assert said == (
        "ValueError: two lines (a fault of roller: please report it; "
        "ROLLER_TRACEBACK=1 shows where)"
    )
    said = describe_fault_of_ours(ValueError("x"), "the node ends")
    assert said.startswith("ValueError: x (a fault of roller, the node ends: please report it; ")
