"""Parameter files that are none: each is refused in one line, and nothing waits for its end."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from roller_core.errors import SettingsError
from roller_core.settings import read_sections

BOMB = ["a0: &a0 [x, x]", *(f"a{k}: &a{k} [*a{k - 1}, *a{k - 1}]" for k in range(1, 60))]


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("\n".join(BOMB), "line 2: aliases"),
        ("emvs: &e {ros__parameters: {}, inner: *e}", "line 1: aliases"),
        ("[" * 5000, "nested too deeply|not a YAML file"),
        ("emvs: [1", "line 1: not a YAML file"),
        ("x" * 10_000_001, "over 10000000 bytes"),
    ],
)
def test_what_is_written_is_bounded(text: str, reason: str, tmp_path: Path) -> None:
    file = tmp_path / "params.yaml"
    file.write_text(text)
    with pytest.raises(SettingsError, match=reason) as refused:
        read_sections(file)
    assert len(str(refused.value)) < 300


def test_pipes_devices_and_folders(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path, reason in (
        (tmp_path / "pipe", "not a file"),
        (Path("/dev/zero"), "not a file"),
        (tmp_path, "Is a directory"),
    ):
        with pytest.raises(SettingsError, match=reason):
            read_sections(path)
