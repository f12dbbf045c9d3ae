"""Document, page and exports of a part; these are read back by other people's software."""

import csv
import json
import re
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest

from roller_core.calibration_file import SECTION
from roller_inspect.height_map import CONTINUED, HeightMap
from roller_inspect.inspect_stage import InspectStage, inspect_parameters
from roller_inspect.judgement import judge_nothing
from roller_inspect.recipe import Recipe
from roller_inspect.report.document import Scan, inspection_document
from roller_inspect.results.inspection_files import write_inspection

from .analytic_surface import scan
from .inspecting import HOLE, PLANE, SMALL, clouds, finished, inspect


def test_files_and_exports(tmp_path: Path) -> None:
    stage, results = inspect(scan(HOLE, **SMALL))
    part = finished(results)
    faults = ["a packet <was> broken"]
    document = inspection_document(part, stage.recipe, Scan(events=10**6, faults=faults))
    write_inspection(tmp_path, document, part.found, 1e-4, ("x3p", "sdf", "pdf"))
    written = json.loads((tmp_path / "inspection.json").read_text())
    assert written == document
    assert (written["part"], written["verdict"]) == ("P-17", "nonconform")
    assert sum(written["coverage"][k] for k in ("measured", "continued", "unmeasured")) == (
        pytest.approx(1.0)
    )
    (found,) = written["findings"]
    contract = "id kind center_m length_m width_m depth_m area_m2 volume_m3 uncertainty confidence"
    assert set(contract.split()) | {"verdict", "outline_m"} <= found.keys()
    with (tmp_path / "findings.csv").open() as file:
        (row,) = csv.DictReader(file)
    assert float(row["depth_m"]) == found["depth_m"]
    assert float(row["U_depth_m"]) == found["uncertainty"]["depth_m"]

    html = (tmp_path / "inspection.html").read_text()
    assert "P-17" in html
    assert "Not conform" in html
    assert "a packet &lt;was&gt; broken" in html
    assert not re.search(r"(?:src|href)=\"(?!data:)", html)  # nothing from elsewhere
    assert "<script" not in html

    grid = HeightMap.load(tmp_path / "height_map.npz")
    known = np.where(grid.state >= CONTINUED, grid.height_m, np.nan)
    scale = json.loads((tmp_path / "height_map.png.json").read_text())
    pixels = cv2.imread(str(tmp_path / "height_map.png"), cv2.IMREAD_UNCHANGED)[::-1]
    assert pixels.dtype == np.uint16
    heights = np.where(pixels > 0, scale["low_m"] + (pixels - 1.0) * scale["step_m"], np.nan)
    np.testing.assert_allclose(heights, known, atol=scale["step_m"])

    # A picture of what was scanned, without the map's empty border.
    picture = cv2.imread(str(tmp_path / "deviation.png"))
    for side in (picture[0], picture[-1], picture[:, 0], picture[:, -1]):
        assert (side != 255).any()

    x3p = pytest.importorskip("verity_x3p").read_x3p(str(tmp_path / "height_map.x3p"))
    assert (x3p.nx, x3p.ny) == (len(grid.x_m), len(grid.y_m))
    assert x3p.increment_x == pytest.approx(grid.step_m)
    np.testing.assert_allclose(x3p.data, known)
    sdf = pytest.importorskip("sdfio").read(str(tmp_path / "height_map.sdf"))
    np.testing.assert_allclose(np.asarray(sdf.data).reshape(known.shape), known, atol=1e-9)


def test_the_uncertainty_is_the_sum_of_its_budget_which_says_what_is_not_calibrated(
    tmp_path: Path,
) -> None:
    params = tmp_path / "cell.yaml"
    cell = {"uncertainty": {"drift_m": 5e-4, "pose_m": 2e-5}}
    params.write_text(json.dumps({"/**/inspect": {"ros__parameters": cell}}))
    figures = {}
    for given, reference in ((None, "nominal"), (params, "nominal:none")):
        recipe = Recipe.create(PLANE | {"reference": reference})
        stage = InspectStage(inspect_parameters(given), recipe)
        for output in clouds(scan(HOLE, **SMALL)):
            stage.take_output(output)
        part = finished(list(stage.results(flush=True)))
        document = inspection_document(part, recipe, Scan(params=given))
        (found,) = document["findings"]
        budget = found["budget_m"]
        assert budget.keys() == document["uncertainty"].keys()
        total = np.sqrt(sum(v**2 for v in budget.values()))
        assert found["uncertainty"]["depth_m"] == pytest.approx(2 * total)
        figures[given] = budget
        write_inspection(tmp_path, document, part.found, 1e-4)
        html = (tmp_path / "inspection.html").read_text()
        assert ("not calibrated" in html) == (given is None)
    assert figures[None]["pose"] == 0.0  # the plane is fitted to the scan itself
    assert figures[params]["pose"] == 2e-5
    assert figures[params]["drift"] > 3 * figures[None]["drift"] > 0


def test_a_part_without_a_point_is_unmeasured(tmp_path: Path) -> None:
    stage, results = inspect([])
    assert results == []
    part = judge_nothing(stage.recipe, "P-18")
    document = inspection_document(part, stage.recipe, Scan())
    write_inspection(tmp_path, document, part.found, 1e-4, ("x3p", "sdf", "pdf"))
    written = json.loads((tmp_path / "inspection.json").read_text())
    assert (written["verdict"], written["coverage"]["unmeasured"]) == ("unmeasured", 1.0)
    assert written["texture"]["sufficient"] is False
    assert "Unmeasured" in (tmp_path / "inspection.html").read_text()
    assert not HeightMap.load(tmp_path / "height_map.npz").known.any()


def test_cells_finer_than_the_finest_scale_needs() -> None:
    """What is smoothed is then worked out on coarser ones."""
    _, results = inspect(scan(HOLE, **SMALL), grid_m=2e-5)
    (judged,) = finished(results).judgement.findings
    assert judged.finding.kind == "dent"
    assert judged.finding.depth_m == pytest.approx(-3e-4, abs=6e-5)


@pytest.mark.parametrize(
    ("dates", "said"),
    [
        ({}, None),
        ({"hand_eye": "2025-03-04T05:06:07Z"}, "2025-03-04T05:06:07Z"),
        (
            {"hand_eye": "2025-03-04T05:06:07Z", "edge_drift": "2024-01-02T03:04:05Z"},
            "2024-01-02T03:04:05Z",
        ),
        ({"hand_eye": "2025-03-04T05:06:07Z", "edge_drift": "last week"}, None),
    ],
)
def test_x3p_has_the_date_of_calibration_or_none(
    dates: dict[str, str], said: str | None, tmp_path: Path
) -> None:
    params = tmp_path / "cell.yaml"
    records = {kind: {"date": date} for kind, date in dates.items()}
    params.write_text(json.dumps({SECTION: {"ros__parameters": records}}))
    stage, results = inspect(scan(HOLE, **SMALL))
    part = finished(results)
    document = inspection_document(part, stage.recipe, Scan(params=params))
    write_inspection(tmp_path, document, part.found, 1e-4, ("x3p",))
    with zipfile.ZipFile(tmp_path / "height_map.x3p") as file:
        record = ElementTree.fromstring(file.read("main.xml")).find("Record2")
    assert (record.findtext("CalibrationDate") if record is not None else None) == said
