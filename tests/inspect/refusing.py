"""Replays of what is no good, and the one line that they give."""

import re
from pathlib import Path

import pytest

from roller_bringup.cli import main

PARAMS = """
emvs:
  ros__parameters: {window.travel_m: 0.006, focus.sigma_px: 3.0, max_pose_gap_s: 0.03}
"""
Capture = pytest.CaptureFixture[str]


def run(tmp_path: Path, capsys: Capture, source: Path, *more: str) -> tuple[int, list[str]]:
    """Exit code and lines on standard error."""
    params = tmp_path / "params.yaml"
    params.write_text(PARAMS)
    words = ["replay", str(source), "--output", str(tmp_path / "out"), "--no-picture"]
    code = main([*words, "--params", str(params), *more])
    return code, [line for line in capsys.readouterr().err.splitlines() if line.strip()]


def refuse(tmp_path: Path, capsys: Capture, source: Path, pattern: str, *more: str) -> None:
    """Replay what is no good; there is one line, which says so."""
    code, errors = run(tmp_path, capsys, source, *more)
    assert code == 1
    (line,) = errors
    assert_matches(line, pattern)


def assert_matches(line: str, pattern: str) -> None:
    assert line.startswith("error: ")
    assert re.search(pattern, line), line
