"""Which skin to print: what is measured of a plate, which skin is named, what a run writes."""

import json
from pathlib import Path

import pytest

from roller_bringup.cli import main
from roller_evaluation.coating import CoatingOptions, coating_cases, recommended, tables, verdict
from roller_evaluation.rows import Row

THRESHOLD = 0.22


def row(contrast: float, grain: float, speed: float, **figures: float | None) -> Row:
    found = {"mae_um": 20.0, "median_um": 15.0, "measured": 0.5, "points_per_mm2": 100.0,
             "mev_per_s": 10.0}  # fmt: skip
    labels = {"contrast": contrast, "grain_mm": grain, "threshold": THRESHOLD, "speed": speed}
    return {**labels, **found, **figures}


def test_the_skin_with_the_fewest_events_of_the_good_ones_is_named() -> None:
    rows = [
        row(0.03, 0.1, 0.3, measured=0.1, mae_um=5.0, mev_per_s=1.0),
        row(0.08, 0.1, 0.3, measured=0.48, mae_um=20.0, mev_per_s=10.0),
        row(0.08, 0.1, 0.5, measured=0.46, mae_um=22.0, mev_per_s=20.0),
        row(0.12, 0.1, 0.3, measured=0.5, mae_um=18.0, mev_per_s=30.0),
        row(0.12, 0.1, 0.5, measured=0.5, mae_um=20.0, mev_per_s=39.0),
        row(0.3, 0.1, 0.5, measured=0.9, mae_um=10.0, mev_per_s=200.0),
        row(0.08, 0.2, 0.3, measured=0.5, mae_um=40.0, mev_per_s=5.0),
        row(0.18, 0.1, 0.3, mae_um=None, measured=0.0),
    ]
    found = recommended(rows)
    assert found is not None
    assert (found["contrast"], found["grain_mm"]) == (0.08, 0.1)
    assert found["mev_per_s"] == pytest.approx(15.0)
    assert "8% RMS contrast and 0.1 mm grain" in verdict(found)
    shown = tables({"rows": rows, "recommended": found})[0]
    assert ("0.3", "0.1", "8% (textured)", "20.0", "15.0", "48%", "100", "10.0") in shown.rows
    assert ("0.3", "0.1", "18%", "–", "15.0", "0%", "100", "10.0") in shown.rows
    assert recommended(rows[-1:]) is None


def test_a_skin_that_measures_next_to_nothing_is_not_named() -> None:
    faint = row(0.03, 0.1, 0.3, measured=0.01, mae_um=5.0, mev_per_s=0.2)
    too_fast = row(0.12, 0.1, 0.3, measured=0.7, mae_um=6.0, mev_per_s=87.0)
    assert recommended([faint, too_fast]) is None
    assert "None of these coatings measures 30%" in verdict(None)


def test_every_coating_is_measured_once() -> None:
    cases = coating_cases(CoatingOptions())
    assert len({case.key for case in cases}) == len(cases)
    o = CoatingOptions()
    assert len(cases) == len(o.contrasts) * (len(o.grains_mm) * len(o.speeds) + 2)


def test_more_contrast_measures_more(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    output = tmp_path / "coating"
    assert main(["evaluate", "coating", "--quick", "--jobs", "1", "--output", str(output)]) == 0
    assert "not fitted to a real roller" in " ".join(capsys.readouterr().out.split())
    faint, strong = json.loads((output / "coating.json").read_text())["rows"]
    assert faint["measured"] < 0.15 < strong["measured"]
    assert 3 * faint["mev_per_s"] < strong["mev_per_s"]
    assert strong["mae_um"] < 60
    found = json.loads((output / "coating.json").read_text())["recommended"]
    assert found["contrast"] == strong["contrast"]
    assert (output / "coating.png").stat().st_size > 20_000
