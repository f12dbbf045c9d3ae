"""Settings and report."""

import json

import pytest

from braille.synthetic import Plate, over, read, scan
from roller_braille.reader_settings import PROFILES, BrailleSettings
from roller_braille.text_files import cells_to_json
from roller_core.errors import RollerError


def test_every_setting_is_described_and_bounded() -> None:
    for name, field in BrailleSettings.model_fields.items():
        assert field.description, name
        if field.annotation in (int, float):
            assert len(field.metadata) >= 2, f"{name} has no range"


def test_own_spacing_goes_before_the_profile() -> None:
    assert BrailleSettings.create({}).spacing == PROFILES["nls"]
    s = BrailleSettings.create({"profile": "wide", "spacing_m": [0.00254, 0.0, 0.0101]}).spacing
    assert (s.dot_pitch_m, s.cell_pitch_m) == (0.00254, 0.0068)
    assert (s.line_pitch_m, s.dot_diameter_m) == (0.0101, 0.0015)


def test_wrong_settings_are_named() -> None:
    with pytest.raises(RollerError, match="depth_m"):
        BrailleSettings.create({"depth_m": -1.0})


def test_cells_as_json() -> None:
    plate = Plate().text("ab c")
    track = over(plate)
    cells, pipeline = read(scan(plate, track), track)
    data = json.loads(json.dumps(cells_to_json(cells, pipeline.lines(), "grade1")))
    assert data["text"] == pipeline.text() == ["ab c"]
    assert data["lines"] == [
        {"line": 0, "text": "ab c", "cells": "⠁⠃⠀⠉", "cell_of_character": [0, 1, 2, 3]}
    ]
    assert [c["character"] for c in data["cells"]] == ["a", "b", " ", "c"]
    first = data["cells"][0]
    assert set(first) == {
        "stamp_s",
        "line",
        "column",
        "mask",
        "pattern",
        "character",
        "readable",
        "position_m",
        "confidence",
        "dot_confidence",
    }
    assert (first["mask"], first["pattern"], len(first["dot_confidence"])) == (1, "⠁", 6)
