"""The page for who uses the methods on arrays of their own does what it says."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

PAGE = Path(__file__).parents[2] / "docs" / "library.md"


@pytest.mark.scan
def test_its_examples_find_the_plane(capsys: pytest.CaptureFixture[str]) -> None:
    names: dict[str, Any] = {}
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)
    for block, limit_m in zip(blocks, (60e-6, 20e-6), strict=True):
        exec(block, names)
        points = names["points"]
        assert len(points) > 2000
        assert np.abs(points[:, 2]).mean() < limit_m
    assert len(names["sigma"]) > 2000
    assert "no depth" not in capsys.readouterr().out
