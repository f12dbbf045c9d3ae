"""What the report draws: charts of a page and of a PDF, profiles over what is allowed."""

import re
import sys
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest

from roller_inspect.exports.pdf import write_pdf
from roller_inspect.report.document import Scan, inspection_document
from roller_inspect.report.svg import Chart
from roller_inspect.results.inspection_files import write_inspection

from .analytic_surface import scan
from .inspecting import HOLE, SMALL, finished, inspect


@pytest.mark.parametrize("installed", [True, False])
def test_a_pdf_needs_nothing_more(
    installed: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if installed:
        pytest.importorskip("weasyprint")
    else:
        monkeypatch.setitem(sys.modules, "weasyprint", None)
    lines = ["NONCONFORM: 50 µm ± 3 µm, $5 \\x", *map(str, range(100))]
    picture = np.zeros((40, 80, 3), np.uint8)
    write_pdf(tmp_path / "page.pdf", "<h1>Not conform</h1>", lines, picture)
    written = (tmp_path / "page.pdf").read_bytes()
    assert written.startswith(b"%PDF-")
    assert installed or b"/Count 2" in written


def test_charts_of_a_pdf_have_their_style_and_no_size_of_their_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen = []

    class Page:
        def __init__(self, string: str) -> None:
            seen.append(string)

        def write_pdf(self, path: str) -> None:
            Path(path).touch()

    monkeypatch.setitem(sys.modules, "weasyprint", SimpleNamespace(HTML=Page))
    chart = Chart((0, 1), (0, 1), "x, mm", "z, µm")
    chart.line([0, 1], [0, 1])
    write_pdf(tmp_path / "page.pdf", f"<figure>{chart}{chart}</figure>", [])
    (html,) = seen
    charts = [ElementTree.fromstring(text) for text in re.findall("(?s)<svg.*?</svg>", html)]
    for svg in charts:
        assert "height" not in svg.attrib
        style = svg.findtext("style")
        assert style is not None
        classes = {kind for part in svg.iter() for kind in part.get("class", "").split()}
        assert classes == {"line", "frame", "tick", "mid", "end"}
        assert all(f".{kind} {{" in style for kind in classes)
    assert len(charts) == 2


def test_a_finding_is_drawn_over_the_depth_that_it_may_have(tmp_path: Path) -> None:
    """One of a region that allows half of it lay over the depth that is allowed elsewhere."""
    regions = {"seal": {"box_m": [0.0, -0.01, 0.1, 0.01]}}

    def bands(name: str, **tolerance: float) -> list[float]:
        own = [{"region": "seal", **tolerance}]
        stage, results = inspect(scan(HOLE, **SMALL), regions=regions, tolerances=own)
        part = finished(results)
        document = inspection_document(part, stage.recipe, Scan())
        write_inspection(tmp_path / name, document, part.found, stage.recipe.depth_tolerance_m)
        page = (tmp_path / name / "inspection.html").read_text()
        return [float(h) for h in re.findall(r'class="band"[^>]* height="([\d.]+)"', page)]

    for name in ("wide", "narrow", "length"):
        (tmp_path / name).mkdir()
    (all_wide, wide), (all_narrow, narrow) = (
        bands("wide", depth_m=1e-4),
        bands("narrow", depth_m=5e-5),
    )
    assert all_wide == all_narrow
    assert narrow == pytest.approx(wide / 2, abs=0.2)
    assert len(bands("length", length_m=1e-3)) == 1
