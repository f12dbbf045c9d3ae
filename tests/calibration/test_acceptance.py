"""What a certificate refuses to be made of."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from recording.bags import CAMERA, Recipe, write_bag
from roller_bringup.cli import main

ACCEPT = ("calibrate", "acceptance", "--radius-mm", "4")
GOLDEN = {"kind": "golden"}
INSPECTION = {
    "schema": "roller-inspection/1",
    "reference": GOLDEN,
    "verdict": "conform",
    "traceability": {"camera": str(CAMERA)},
}


@pytest.fixture
def sphere(tmp_path: Path) -> Path:
    """A recording; it shows no sphere, but is refused before that shows."""
    return write_bag(tmp_path / "ball")


def refused(capsys: pytest.CaptureFixture[str], tmp_path: Path, *words: object) -> str:
    """What is said, in one line; nothing is left behind."""
    out = tmp_path / "certificate"
    assert main([*ACCEPT, *map(str, words), "--output", str(out)]) == 1
    assert not out.exists()
    (line,) = capsys.readouterr().err.splitlines()
    return line


def test_gauges_of_two_cameras(
    sphere: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    other = replace(CAMERA, fx=CAMERA.fx * 0.9, fy=CAMERA.fy * 0.9)
    steps = write_bag(tmp_path / "stairs", Recipe(camera=other))
    words = ("--sphere", sphere, "--steps", steps, "--step-mm", 0.2)
    said = refused(capsys, tmp_path, *words)
    assert said.startswith(f"error: {steps} is of another camera (")
    assert f") than {sphere} (" in said


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"schema": None}, "is no inspection"),
        ({"schema": "roller-acceptance/2"}, "is no inspection"),
        ({"reference": "golden"}, "is no inspection"),
        ({"traceability": {"camera": "another"}}, "was seen by another camera (another)"),
        ({"traceability": {}}, "was seen by another camera"),
    ],
)
def test_an_inspection_that_is_none_or_of_another_camera(
    change: dict[str, Any], says: str, sphere: Path, tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    part = tmp_path / "part"
    part.mkdir()
    words = ("--sphere", sphere, "--inspection", part)
    (part / "inspection.json").write_text(json.dumps(INSPECTION | change))
    assert says in refused(capsys, tmp_path, *words)
    for text in ("[]", "nothing", ""):
        (part / "inspection.json").write_text(text)
        assert "inspection.json: " in refused(capsys, tmp_path, *words)
    # One that is right is no reason: what follows is.
    (part / "inspection.json").write_text(json.dumps(INSPECTION))
    assert "inspection" not in refused(capsys, tmp_path, *words)
