"""The paper's experiments: which passes they take, what the tables say, going on after a break."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from roller_bringup.cli import main
from roller_evaluation import measured as measuring
from roller_evaluation.experiments import run_evaluation
from roller_evaluation.measured import Measured, measure
from roller_evaluation.page import page
from roller_evaluation.paper_tables import error, tables
from roller_evaluation.plan import EXPERIMENTS, OURS, EvaluationOptions, passes
from roller_evaluation.repeated_passes import METHODS, Pass, settings_of, tops_of
from roller_evaluation.tables import Table
from roller_evaluation.weights import weight_choices
from roller_sim.relief import Region

#: A narrow camera over a coarse plate: seconds instead of minutes.
CELL = {"scene": {"step_mm": 0.06}, "camera": {"width": 480, "height": 96}}
SMALL = EvaluationOptions(
    only=("weights", "fusion", "objects"), repeats=1, objects=("stairs",), cell=CELL, quick=True
)


def figures(mae_um: float | None, edges: float) -> dict[str, object]:
    return {"mae_um": mae_um, "edges_measured": edges, "points": 10, "spread_um": 5.0,
            "tops_measured": 0.25, "tops_um":
                [{"mean": 600.0, "points": 3}, None, {"mean": 610.0, "points": 2}],
            "objects": {}}  # fmt: skip


def weight_figures(scene: str) -> dict[str, object]:
    """The further from the best weights, the more error; 10 µm there."""
    best = {"stairs": (0.5, 0.5, 0.0), "sphere": (1 / 3, 1 / 3, 1 / 3)}.get(scene, (0, 0, 1))
    away = np.abs(weight_choices() - best).sum(axis=1)
    return {"mae_um": (10 + 30 * away).tolist(), "points": [100] * len(away), "pixels": 400}


def made_up(options: EvaluationOptions) -> Measured:
    """Figures that tell which pass they are of: 100 times the seed, and the speed."""
    return Measured(
        {
            p: {"events": 1000 * p.seed,
                "methods": {m: figures(100.0 * p.seed + p.speed, 0.5) for m in methods}
                | ({"weights": weight_figures(p.scene)} if "weights" in methods else {})}
            for p, methods in passes(options).items()
        }
    )  # fmt: skip


def test_a_pass_is_measured_once_with_all_methods_that_want_it() -> None:
    found = passes(EvaluationOptions())
    sphere = found[Pass("sphere", 0.3, 1)]
    assert set(sphere) == set(METHODS)
    assert len(sphere) == len(set(sphere))
    assert {p.seed for p in found} == {1, 2, 3, 4, 5}
    assert {p.contact for p in found if p.scene == "bumps"} == {"light", "medium", "full"}
    assert len({p.name for p in found}) == len(found)
    for name in METHODS:
        settings_of(name)


def test_no_experiment_that_has_no_passes_takes_any() -> None:
    assert not passes(EvaluationOptions(only=("time", "braille")))


def test_tables_hold_mean_deviation_and_coverage() -> None:
    options = EvaluationOptions(repeats=3)
    found = tables(made_up(options), options)
    assert list(found) == [name for name in EXPERIMENTS if name not in ("time", "braille")]
    rows = {row[0]: row for row in found["weights"].rows}
    assert rows["sphere, the paper"][:5] == ("sphere, the paper", "0.445", "0.333", "0.222", "54.9")
    # In the middle between the others it is best for all; order: stairs, sphere, sparse_sphere.
    assert rows["sphere"][1:4] == ("0.333", "0.333", "0.333")
    assert rows["sphere"][4:] == ("30.0 (25.0%)", "30.0 (25.0%)", "10.0 (25.0%)", "50.0 (25.0%)")
    assert rows["focus, without"][4] == "200.3 ± 100.0 (50%)"
    assert rows["stairs"][1:4] == ("0.500", "0.500", "0.000")
    rows = {row[0]: row for row in found["fusion"].rows}
    assert rows["BMA, the paper"] == ("BMA, the paper", "58.1", "94.6", "12.0", "54.9")
    assert rows["BMA"][1] == "200.3 ± 100.0 (50%)"
    assert rows["focus"][4] == "200.3 ± 100.0 (50%)"
    assert dict((r[0], r[1]) for r in found["objects"].rows)["all"] == "62.0 ± 4.7"
    lines = {row[0]: row for row in found["lines"].rows}
    assert lines["EMVS"][1:4] == ("67", "5.0 (25%)", "10.0")
    assert [row[0] for row in found["force"].rows] == ["light", "medium", "full"]
    assert found["force"].rows[0][1] == "0.00"
    for table in found.values():
        assert all(len(row) == len(table.head) for row in table.rows), table.title


def test_what_was_not_measured_is_left_open() -> None:
    own = [Pass("stairs", 0.3, seed) for seed in (1, 2)]
    methods = [{"bma": figures(None, 0.1)}, {"bma": figures(50.0, 0.3)}]
    measured = Measured({p: {"methods": m} for p, m in zip(own, methods, strict=True)})
    assert error(measured, own, "bma") == "50.0 (20%)"
    assert error(measured, own[:1], "bma") == "–"


def test_tops_are_away_from_walls() -> None:
    points = np.array([[0.0005, 0.0, 6e-4], [0.0001, 0.0, 1e-4], [0.002, 0.0, 0.0]])
    heights, measured = tops_of(points, Region("line", 0.0, 0.001, -0.001, 0.001))
    assert heights.tolist() == [6e-4]
    # One of 6 × 16 cells of 0.1 mm.
    assert measured == pytest.approx(1 / 96)


def test_a_page_is_whole_and_escapes() -> None:
    table = Table("t", ("a<b", "c"), [("1 & 2", "3")], "note")
    html = page([("Title", [table], [("a figure", b"png")])], {"k": "<v>"}, "{}")
    for text in ("a&lt;b", "1 &amp; 2", "&lt;v&gt;", "data:image/png;base64,cG5n", "a figure"):
        assert text in html
    assert 'src="http' not in html


def test_a_run_that_was_broken_off_goes_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = run_evaluation(SMALL, tmp_path, jobs=2)
    assert list(found) == ["weights", "fusion", "objects"]
    html = (tmp_path / "index.html").read_text()
    assert html.count("data:image/png") == 2
    result = json.loads((tmp_path / "evaluation.json").read_text())
    (only,) = result["passes"]
    assert set(only["methods"]) == {"weights", "emvs", "left_right", *OURS}
    # The search gives what the pipeline does with its own weights, to how they are rounded.
    own = np.abs(weight_choices() - (8 / 18, 6 / 18, 4 / 18)).sum(axis=1).argmin()
    searched = only["methods"]["weights"]
    assert searched["mae_um"][own] == pytest.approx(only["methods"]["bma"]["mae_um"], abs=0.5)
    assert searched["points"][own] == only["methods"]["bma"]["points"]
    for name in OURS:
        assert only["methods"][name]["mae_um"] < 400
        assert 0.2 < only["methods"][name]["edges_measured"] <= 1.0

    def never(*_: object, **__: object) -> None:
        raise AssertionError("measured again")

    # The same seed gives the same, in one process as in two.
    anew = run_evaluation(SMALL, tmp_path / "anew", jobs=1)
    assert anew == found
    assert json.loads((tmp_path / "anew" / "evaluation.json").read_text()) == result

    monkeypatch.setattr(measuring, "measure_pass", never)
    wanted = passes(SMALL)
    again = measure(wanted, CELL, tmp_path / "passes", 1, lambda *_: None)
    assert again.as_json() == result["passes"]
    # Other settings are another measurement, and so is an older form or a file that was cut off.
    with pytest.raises(AssertionError, match="measured again"):
        measure(wanted, {}, tmp_path / "passes", 1, lambda *_: None)
    (file,) = (tmp_path / "passes").iterdir()
    whole = file.read_text()
    file.write_text(whole.replace('"form": 2', '"form": 1'))
    with pytest.raises(AssertionError, match="measured again"):
        measure(wanted, CELL, tmp_path / "passes", 1, lambda *_: None)
    file.write_text(whole)
    file.write_text(file.read_text()[:100])
    with pytest.raises(AssertionError, match="measured again"):
        measure(wanted, CELL, tmp_path / "passes", 1, lambda *_: None)


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--only", "nothing"], "'nothing' is none of weights"),
        (["--repeats", "0"], "--repeats and --jobs: at least 1"),
        (["--jobs", "0"], "--repeats and --jobs: at least 1"),
        (["--output", "/proc/nowhere"], "results can't be written there"),
    ],
)
def test_wrong_options_get_one_line(
    words: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["evaluate", *words]) == 1
    errors = capsys.readouterr().err.strip().splitlines()
    assert len(errors) == 1
    assert says in errors[0]
