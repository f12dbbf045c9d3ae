"""The paper's experiments: which passes they take, what the tables say, going on after a break."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from roller_bringup.cli import main
from roller_core.errors import UnwritableOutputError
from roller_evaluation.cases import Case, ScanCase
from roller_evaluation.evaluation import run_evaluation
from roller_evaluation.experiments import (
    EXPERIMENTS,
    FUSIONS,
    OURS,
    EvaluationOptions,
    experiment_cases,
    timed_cases,
)
from roller_evaluation.measures import MEASURES, tops_of
from roller_evaluation.page import page
from roller_evaluation.paper_tables import error, tables
from roller_evaluation.results_page import END, check_results, write_results
from roller_evaluation.rows import Row, where
from roller_evaluation.scans import Scan
from roller_evaluation.tables import Table
from roller_evaluation.time_table import processing_time
from roller_evaluation.weights import weight_choices
from roller_sim.relief import Region


def made_up(cases: list[Case]) -> list[Row]:
    """Rows that tell which pass they are of: 100 times the seed, and the speed."""
    rows: list[Row] = []
    for case in cases:
        own = {"object": case.scan.scene, "events": 1000, "points": 10, "edges_measured": 0.5}
        own["mae_um"] = own["near_edge_mae_um"] = 100.0 * case.scan.seed + case.scan.speed
        if case.measure == "weights":
            # The further from the best weights, the more error; 10 µm there.
            best = {"stairs": (0.5, 0.5, 0.0), "sphere": (1 / 3, 1 / 3, 1 / 3)}
            away = np.abs(weight_choices() - best.get(case.scan.scene, (0, 0, 1))).sum(axis=1)
            found = [
                {"choice": k, "mae_um": 10 + 30 * d, "points": 100, "pixels": 400}
                for k, d in enumerate(away.tolist())
            ]
        elif case.measure == "plate":
            tops = {"line_0": 600.0, "line_1": None, "line_2": 610.0}
            plate = {"object": "plate", "spread_um": 5.0, "tops_measured": 0.25}
            found = [plate, *({"object": k, "top_um": v} for k, v in tops.items())]
        elif case.measure == "map":
            each = {"mae_um": 40.0, "within": 0.875, "share": 0.25}
            names = ("map", "linear", "measured")  # nothing is continued
            found = [{f"{name}_{k}": v for name in names for k, v in each.items()}]
        else:
            found = [{"ms_mean": 2.0, "ms": 2.0, "ms_p95": 3.0, "ms_per_mev": 200.0,
                      "cpu_ms": 3.0, "cpu_ms_per_mev": 300.0, "windows": 3, "refused": 0,
                      "median_um": 1.0, "bias_um": 0.0, "within_100_um": 1.0}]  # fmt: skip
        rows += [{**case.columns, **own, **f} for f in found]
    return rows


def test_a_pass_is_measured_once_with_all_methods_that_want_it() -> None:
    cases = experiment_cases(EvaluationOptions())
    assert len({case.key for case in cases}) == len(cases)
    sphere = [c for c in cases if (c.scan.scene, c.scan.speed, c.scan.seed) == ("sphere", 0.3, 1)]
    assert {c.method for c in sphere if c.measure == "depth"} == {*FUSIONS, "bma_5"}
    assert [c.method for c in sphere if c.measure == "weights"] == ["bma"]
    assert {c.scan.seed for c in cases if c.measure != "map"} == {1, 2, 3, 4, 5}
    assert {c.scan.seed for c in cases if c.measure == "map"} == set(range(1, 11))
    bumps = {c.labels["contact"] for c in cases if c.scan.scene == "bumps"}
    assert bumps == {"light", "medium", "full"}
    assert {c.measure for c in cases} < set(MEASURES)
    assert not experiment_cases(EvaluationOptions(only=("time", "braille")))


def test_what_was_calibrated_in_a_light_holds_there() -> None:
    """A drift moves along with the light that causes it, and only these two correct it."""
    drift = {
        "edge_drift": {
            "coefficients_m": [-1e-4, 0, 0, 0],
            "residual_m": [3e-5] * 24,
            "max_slope": 0.8,
        }
    }
    options = EvaluationOptions(
        repeats=1, only=("objects",), objects=("stairs",), lights=("ring", "dome", "strong"),
        calibrated={"ring": {"focus": drift, "surface": drift}, "strong": {"surface": drift}},
    )  # fmt: skip
    corrected = {
        (case.method, case.labels["light"])
        for case in experiment_cases(options)
        if any(case.depth.edge_drift.coefficients_m)
    }
    assert corrected == {("focus", "ring"), ("surface", "ring"), ("surface", "strong")}
    timed = {case.method for case in timed_cases(options) if "edge_drift" in case.settings}
    assert timed == {"focus", "surface"}


def test_tables_hold_mean_deviation_and_coverage() -> None:
    options = EvaluationOptions(repeats=3)
    found = tables(made_up(experiment_cases(options)), options)
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
    by_name = {r[0]: r for r in found["objects"].rows}
    assert by_name["all"][1:3] == ("62.0 ± 4.7", "200.3 ± 100.0 (50%)")
    # One pass in the lights beside the ring.
    assert by_name["all, dome"][1:3] == by_name["sphere, strong"][1:3] == ("–", "100.3 (50%)")
    lines = {row[0]: row for row in found["lines"].rows}
    assert lines["EMVS"][1:4] == ("67", "5.0 (25%)", "10.0")
    assert [row[0] for row in found["force"].rows] == ["light", "medium", "full"]
    assert found["force"].rows[0][1] == "0.00"
    for table in found.values():
        assert all(len(row) == len(table.head) for row in table.rows), table.title


def test_what_was_not_measured_is_left_open() -> None:
    rows = [{"mae_um": None, "edges_measured": 0.1}, {"mae_um": 50.0, "edges_measured": 0.3}]
    assert error(rows) == "50.0 (20%)"
    assert error(rows[:1]) == "–"


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


def test_the_search_of_weights_is_the_pipeline_with_its_own(stairs: Scan) -> None:
    case = Case(ScanCase("stairs", 0.3), "weights", "bma")
    rows = MEASURES["weights"](case, stairs)
    assert len(rows) == len(weight_choices())
    own = np.abs(weight_choices() - (8 / 18, 6 / 18, 4 / 18)).sum(axis=1).argmin()
    (bma,) = MEASURES["depth"](case, stairs)
    # To how the weights are rounded.
    assert rows[own]["mae_um"] == pytest.approx(bma["mae_um"], abs=0.5)
    assert rows[own]["points"] == bma["points"]


def test_a_run_writes_its_files(cell: dict[str, Any], tmp_path: Path) -> None:
    options = EvaluationOptions(
        only=("speed", "objects"), repeats=1, objects=("stairs",), speeds=(0.3,),
        lights=("ring", "dome"), cell=cell, quick=True,
    )  # fmt: skip
    found = run_evaluation(options, tmp_path)
    assert list(found["tables"]) == ["objects", "speed"]
    assert (tmp_path / "index.html").read_text().count("data:image/png") == 3
    result = json.loads((tmp_path / "evaluation.json").read_text(), parse_constant=pytest.fail)
    assert result["rows"] == json.loads(json.dumps(found["rows"]))
    own = where(result["rows"], measure="depth", scene="stairs")
    assert [(r["light"], r["method"]) for r in own] == [
        (light, method) for light in ("ring", "dome") for method in OURS
    ]
    ring, dome = (where(own, method="focus", light=light)[0] for light in ("ring", "dome"))
    assert ring["mae_um"] != dome["mae_um"]
    assert (tmp_path / "rows.csv").read_text().count("\n") == len(result["rows"]) + 1


def test_a_plate_has_a_row_and_its_objects_theirs(stairs: Scan) -> None:
    case = Case(ScanCase("stairs", 0.3), "plate", "surface")
    plate, single = MEASURES["plate"](case, stairs)
    assert (plate["object"], single["object"]) == ("plate", "stairs")
    for row in (plate, single):
        assert 0 < row["mae_um"] < 400
        assert 0.2 < row["edges_measured"] <= 1.0
    assert 0 < single["top_points"] <= single["points"] <= plate["points"]


def test_a_map_is_compared_with_a_linear_one(stairs: Scan) -> None:
    case = Case(ScanCase("stairs", 0.3), "map", "surface")
    (row,) = MEASURES["map"](case, stairs)
    assert row["cells"] > 5000
    assert row["map_share"] == row["linear_share"] == 1.0
    assert 0 < row["measured_share"] + row["continued_share"] <= 1.0
    for name in ("map", "linear", "measured"):
        assert 0 < row[f"{name}_mae_um"] < 400
        assert 0.2 < row[f"{name}_within"] <= 1.0


def test_the_page_of_results_is_made_from_rows(tmp_path: Path) -> None:
    options = EvaluationOptions(only=("objects", "sensors", "map", "time", "braille"), repeats=2)
    timed = made_up(timed_cases(options))
    read = {"condition": "default", "method": "auto", "character_error_rate": 0.125}
    facts = {"passes of each kind": 2, "seeds": "1, 2", "processor": "A chip", "cores": 3,
             "date": "2001-02-03", "system": "Linux", "python": "3.9", "form": "full"}  # fmt: skip
    result = {
        "rows": made_up(experiment_cases(options)),
        "time": [{**row, "run": k} for k in (0, 1) for row in timed],
        "braille": {"rows": [{**read, "speed": speed} for speed in (0.3, 0.5)]},
        "facts": facts,
    }
    write_results(result, options, ["roller", "evaluate", "--only", "a b"], tmp_path / "r.md")
    text = (tmp_path / "r.md").read_text()
    for words in ("2001-02-03", "A chip, 3 cores", "python 3.9", "2 passes", "--only 'a b'"):
        assert words in text
    assert "| sphere | 94.6 ± 8.1 | 150.3 ± 70.7 (50%) |" in text
    assert "| sphere | 94.6 ± 8.1 | 150.5 ± 70.7 (50%) |" in text
    assert "| focus | 0.3 | 2.0 ± 0.0 | 24.5 mm of travel | 200 | 300 | 100.3 | 50% |" in text
    assert "| default | 12% | 12% |" in text
    assert "| focus, dome | 100.3 (50%) | 100.3; 1.0 | 100.5 (50%) | 100.5; 1.0 |" in text
    assert "| sphere, dome | 40.0 (88%) | 40.0 (88%) | 25%: 40.0 (88%) | –: – |" in text
    assert "](speed_vs_error.png)" in text
    assert (tmp_path / "speed_vs_error.png").stat().st_size > 15_000
    assert len(processing_time(result["time"]).rows) == 1 + 2 * len(FUSIONS)
    check_results(tmp_path / "r.md")  # it may be written again
    for foreign in (tmp_path / "r.md", tmp_path / "speed_vs_error.png"):
        foreign.write_text("my own")
        page = tmp_path / "r.md"
        with pytest.raises(UnwritableOutputError, match="roller did not write it"):
            write_results(result, options, ["roller"], page)
        assert foreign.read_text() == "my own"
        page.unlink(missing_ok=True)


@pytest.mark.parametrize(
    "below",
    [
        b"",
        b"## By hand\n\n40 \xc2\xb5m\n",
        b"\r\nlines of another system\r\n",
        b"no line's end, no UTF-8: \xb5m",
        b"the line\n" + END.encode() + b"\nonce more\n\n\n",
    ],
)
def test_what_people_wrote_below_the_results_is_kept(tmp_path: Path, below: bytes) -> None:
    page = tmp_path / "r.md"

    def write(date: str) -> bytes:
        facts = {"processor": "A chip", "cores": 3, "date": date, "system": "Linux"}
        rows = [{"condition": "default", "method": "auto", "speed": 0.3}]
        braille = {"rows": [{**row, "character_error_rate": 0.125} for row in rows]}
        options = EvaluationOptions(only=("braille",), repeats=1)
        result = {"rows": [], "braille": braille, "facts": facts}
        write_results(result, options, ["roller", "evaluate"], page)
        return page.read_bytes()

    assert write("2001-02-03").endswith(f"\n\n{END}\n".encode())
    with page.open("ab") as file:
        file.write(below)
    second = write("2004-05-06")
    written, _, kept = second.partition(f"{END}\n".encode())
    assert b"2004-05-06" in written
    assert kept == below
    assert write("2004-05-06") == second
    page.write_bytes(written + below.replace(END.encode(), b""))  # a page without the line
    assert write("2004-05-06") == written + END.encode() + b"\n"


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--only", "nothing"], "'nothing' is none of weights"),
        (["--output", "/proc/nowhere"], "results can't be written there"),
        (["--params", "config/ur10.yaml"], "no edge_drift in it"),
    ],
)
def test_wrong_options_get_one_line(
    words: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["evaluate", *words]) == 1
    errors = capsys.readouterr().err.strip().splitlines()
    assert len(errors) == 1
    assert says in errors[0]


def test_what_is_no_number_is_said_without_names_of_ours(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit):
        main(["evaluate", "coating", "--speeds", "0.3m/s"])
    assert "--speeds: '0.3m/s' is not numbers with commas" in capsys.readouterr().err


@pytest.mark.parametrize("words", [["--only", ""], ["--lights", ","], ["pod", "--kinds", " "]])
def test_a_choice_of_nothing_replaces_no_results(
    words: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as caught:
        main(["evaluate", *words, "--output", str(tmp_path / "out")])
    assert caught.value.code == 2
    assert "nothing is named; leave the option out for its default" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
