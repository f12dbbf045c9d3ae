"""What the shipped calibration is for: with it a printed skin is measured enough to be judged."""

import json
from pathlib import Path

import pytest

from roller_bringup.cli import main
from roller_sim.presets import COATINGS
from simulated_scans import Scans

CALIBRATION = Path(__file__).parents[2] / "config" / "virtual_cell_ring.yaml"


@pytest.mark.parametrize("method", ["focus", "surface"])
def test_a_printed_skin_is_measured(method: str, scans: Scans, tmp_path: Path) -> None:
    """A calibration that makes flat ground unsure leaves nothing of it measured."""
    scan = {"scene": {"margin_mm": 2.0, "step_mm": 0.03}}
    bag, out = scans.bag("stairs", **scan, **COATINGS["textured"]), tmp_path / "out"
    words = ["inspect", str(bag), "--method", method, "--params", str(CALIBRATION)]
    assert main([*words, "--no-picture", "--no-braille", "--output", str(out)]) in (0, 1, 3)
    document = json.loads((out / "inspection.json").read_text())
    assert document["texture"]["sufficient"] is True
    assert document["coverage"]["measured"] > 0.3
    # Inspection averages by itself.
    settings = json.loads((out / "report.json").read_text())["settings"]
    assert not any(settings[node]["average_flats"] for node in ("emvs", "surface"))
