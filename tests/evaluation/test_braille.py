"""The Braille experiment: how texts are compared, what a run writes and says."""

import json
from pathlib import Path
from typing import Any

import pytest

from roller_braille.table import UNREADABLE
from roller_bringup.cli import main
from roller_evaluation.braille import CONDITIONS, BrailleOptions, braille_cases, run_braille
from roller_evaluation.braille_reading import dot_contrast
from roller_evaluation.braille_report import tables
from roller_evaluation.braille_score import Score, align, score
from roller_evaluation.cases import ScanCase
from roller_evaluation.tables import show_tables


def test_a_text_read_as_it_is_has_no_errors() -> None:
    lines = ["the fox", "and 42"]
    assert score(lines, lines) == Score(characters=13, right=13, words=4)
    assert score(lines, lines).character_error_rate == 0.0


@pytest.mark.parametrize(
    ("read", "expected"),
    [
        (["thx fox"], {"right": 6, "wrong": 1, "misread": 1, "wrong_words": 1}),
        ([f"th{UNREADABLE} fox"], {"right": 6, "unreadable": 1, "misread": 0, "wrong_words": 1}),
        (["he fox"], {"right": 6, "missed": 1, "misread": 0, "wrong_words": 1}),
        (["the ffox"], {"right": 7, "extra": 1, "misread": 1, "wrong_words": 1}),
        ([f"the fox{UNREADABLE}"], {"right": 7, "extra": 1, "misread": 0, "wrong_words": 1}),
        (["the fox", "jumps"], {"right": 7, "extra": 5, "misread": 5, "wrong_words": 1}),
        ([], {"right": 0, "missed": 7, "wrong_words": 2}),
    ],
)
def test_what_becomes_of_characters(read: list[str], expected: dict[str, int]) -> None:
    result = score(read, ["the fox"])
    assert {name: getattr(result, name) for name in expected} == expected
    assert result.right + result.wrong + result.unreadable + result.missed == 7
    edits = 7 - result.right + result.extra
    assert result.character_error_rate == pytest.approx(edits / 7)
    assert result.character_accuracy == pytest.approx(result.right / 7)


def test_an_unreadable_cell_is_paired_with_a_character_that_is_there() -> None:
    # A wrong letter and an unreadable one too many would be as few edits.
    assert align(f"a{UNREADABLE}c", "abc") == [("a", "a"), (UNREADABLE, "b"), ("c", "c")]
    assert align(f"{UNREADABLE}x", "b") == [(UNREADABLE, "b"), ("x", "")]


def test_a_line_that_is_missing_costs_its_own_characters_alone() -> None:
    result = score(["second one"], ["first", "second one"])
    assert (result.right, result.missed, result.wrong) == (10, 5, 0)


SMALL = BrailleOptions.short(text="fox", conditions=("default",), fault_speed=0.5)


@pytest.fixture(scope="module")
def quick(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    folder = tmp_path_factory.mktemp("evaluation")
    return folder, run_braille(SMALL, folder)


def test_a_quick_run_reads_its_plate_and_writes_its_files(
    quick: tuple[Path, dict[str, Any]],
) -> None:
    folder, returned = quick
    result = json.loads((folder / "braille.json").read_text(), parse_constant=pytest.fail)
    assert result == json.loads(json.dumps(returned))
    assert [r["method"] for r in result["rows"]] == ["auto", "all events"]
    for row in result["rows"] + result["faults"]:
        parts = ("right", "wrong", "unreadable", "missed")
        assert sum(row[p] for p in parts) == row["characters"] == len("fox")
        assert row["batches"] > 0
        assert row["ms_20000_events"] > 0
    auto = result["rows"][0]
    assert (auto["text"], auto["character_error_rate"], auto["misread"]) == (["fox"], 0.0, 0)
    faults = {(r["fault"], r["refined"]): r["character_error_rate"] for r in result["faults"]}
    assert faults["speed -10%", True] == 0.0 < faults["speed -10%", False]
    assert (folder / "braille.png").stat().st_size > 15_000


def test_every_condition_is_read_at_its_speeds() -> None:
    options = BrailleOptions()
    cases = braille_cases(options)
    scans = {case.scan.key for case in cases}
    hard = len(options.conditions) - 1
    assert len(scans) == len(options.speeds) + hard * len(options.hard_speeds)
    assert len({case.key for case in cases}) == len(cases)
    faults = [case for case in cases if case.labels["fault"] is not None]
    assert {case.scan.speed for case in faults} == {options.fault_speed}
    assert len(faults) == 2 * 5


def test_the_tables_hold_every_row_and_the_published_figures(
    quick: tuple[Path, dict[str, Any]], capsys: pytest.CaptureFixture[str]
) -> None:
    result = quick[1]
    show_tables(tables(result))
    printed = capsys.readouterr().out
    for text in ("default, auto", "default, all events", "87.5%", "95.3%", "19.26"):
        assert text in printed
    for fault in result["faults"]:
        assert fault["fault"] in printed
    assert "less than the threshold" not in printed


def test_what_a_dot_changes_in_each_light_stands_beside_the_threshold(
    quick: tuple[Path, dict[str, Any]], capsys: pytest.CaptureFixture[str]
) -> None:
    found = {
        name: dot_contrast(ScanCase("braille", 0.3, cell=SMALL.cell).changed(**CONDITIONS[name]))
        for name in ("default", "10 × noise", "strong light")
    }
    assert found["default"] == found["10 × noise"] == pytest.approx(0.30, abs=0.04)
    assert found["strong light"] == pytest.approx(2 * found["default"], rel=0.15)
    faint = {**quick[1]["rows"][0], "condition": "half contrast", "threshold": 0.44}
    show_tables(tables({**quick[1], "rows": [*quick[1]["rows"], faint]}))
    printed = " ".join(capsys.readouterr().out.split())
    assert "half contrast: a dot changes log intensity by 0.30, less than the threshold" in printed
    assert printed.count("less than the threshold") == 1


@pytest.mark.parametrize(
    ("options", "word"),
    [(["--speeds", "9"], "--speeds"), (["--text", "a!"], "'!'")],
)
def test_bad_arguments_are_refused_in_a_line(
    options: list[str], word: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert (
        main(["evaluate", "braille", "--quick", "--jobs=1", f"--output={tmp_path}", *options]) == 1
    )
    error = capsys.readouterr().err
    assert word in error
    assert error.count("\n") == 1
