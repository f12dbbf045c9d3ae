"""From points to parts, their findings and verdicts."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from roller_bringup.cli import main
from roller_core.outputs import DEVIATION, FINDINGS
from roller_inspect.height_map import CONTINUED, MEASURED
from roller_inspect.height_map.coverage import Coverage
from roller_inspect.inspect_stage import NoPartError
from roller_inspect.judgement import Inspected
from roller_inspect.report.document import Scan, inspection_document
from roller_inspect.report.html import measure_words
from roller_inspect.report.texture import SHOWN_A90_95_UM, texture

from .analytic_surface import flat, scan
from .inspecting import HOLE, SMALL, clouds, finished, inspect


def test_the_depth_that_a_report_says_is_found_is_that_of_the_results() -> None:
    results = (Path(__file__).parents[2] / "docs" / "results.md").read_text(encoding="utf-8")
    assert re.findall(r"^All kinds: a90 \d+ µm, a90/95 (\d+) µm", results, re.MULTILINE) == [
        str(SHOWN_A90_95_UM)
    ]


def test_the_list_is_whole_revised_and_final_at_the_end() -> None:
    _, results = inspect(scan(HOLE, length_m=0.044, width_m=0.006))
    outs = [o for r in results for o in r.outputs]
    lists = [o.data for o in outs if o.topic == FINDINGS]
    assert [known.revision for known in lists] == list(range(1, len(lists) + 1))
    assert [known.finished for known in lists] == [False] * (len(lists) - 1) + [True]
    assert lists[0].judgement.verdict == "inconclusive"
    assert any(known.judgement.findings for known in lists[:-1])
    (judged,) = lists[-1].judgement.findings
    assert judged.finding.final
    assert judged.verdict == lists[-1].judgement.verdict == "nonconform"
    assert judged.limit == "depth at most 100 µm"
    cells = np.concatenate([o.data.columns for o in outs if o.topic == DEVIATION])
    assert cells[:, 3].min() == pytest.approx(-3e-4, abs=5e-5)
    assert set(cells[:, 5]) <= {CONTINUED, MEASURED}
    np.testing.assert_allclose([cells[:, 0].min(), cells[:, 0].max()], [0, 0.044], atol=1e-3)


def test_parts_end_on_request_and_when_the_source_starts_again() -> None:
    stage, _ = inspect([])
    with pytest.raises(NoPartError, match=r"^P-17: no points yet$"):
        stage.finish()
    for output in clouds(scan(flat, **SMALL), t_ns=10**12):
        stage.take_output(output)
    said = stage.finish()
    assert said.startswith("P-17: conform: no findings"), said
    with pytest.raises(NoPartError) as none:
        stage.finish()
    assert str(none.value) == f"P-17 2: no points yet; before: {said}"
    for output in clouds(scan(HOLE, **SMALL), t_ns=2 * 10**12):
        stage.take_output(output)
    assert stage.start() == "P-17 3 begins with the next points"
    for output in clouds(scan(flat, **SMALL), t_ns=3 * 10**12) + clouds(
        scan(flat, **SMALL), t_ns=10**12
    ):
        stage.take_output(output)
    parts = [r.found for r in stage.results(flush=True) if isinstance(r.found, Inspected)]
    assert [p.part for p in parts] == ["P-17", "P-17 2", "P-17 3", "P-17 4"]
    verdicts = [p.judgement.verdict for p in parts]
    assert verdicts == ["conform", "nonconform", "conform", "conform"]
    # Of a part that ended by itself it is said once.
    assert stage.finish().startswith("P-17 4: conform")
    with pytest.raises(NoPartError, match=r"^P-17 5: no points yet; before: P-17 4: conform"):
        stage.finish()


@pytest.mark.parametrize(
    ("recipe", "verdict", "reason"),
    [
        ({"tolerances": [{"depth_m": 1e-3}]}, "conform", "1 finding, within tolerance"),
        ({"tolerances": [{"depth_m": 2.9e-4}]}, "inconclusive", "1 finding as near to its limit"),
        (
            {"regions": {"a": {"box_m": [0, -0.01, 0.1, 0.01]}}, "inspect": ["a"]},
            "unmeasured", "of the area to inspect was measured",
        ),
        ({"regions": {"a": {"circle_m": [0.008, 0, 0.003]}}, "exclude": ["a"]}, "conform", "no f"),
    ],
)  # fmt: skip
def test_verdicts(recipe: dict[str, Any], verdict: str, reason: str) -> None:
    known = finished(inspect(scan(HOLE, **SMALL), **recipe)[1]).judgement
    assert known.verdict == verdict, known.reason
    assert reason in known.reason


def test_what_reaches_into_a_region_is_held_against_its_tolerance() -> None:
    def groove(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        inside = (np.abs(x - 0.008) < 5e-3) & (np.abs(y) < 5e-4)
        return np.where(inside, -2e-4 * (1 - (y / 5e-4) ** 2) ** 2, 0.0)

    # Its middle lies in the coarse half, its end in the fine one.
    regions = {
        "coarse": {"box_m": [0, -0.01, 0.01, 0.01]},
        "fine": {"box_m": [0.01, -0.01, 0.02, 0.01]},
    }
    tolerances = [{"region": "fine", "depth_m": 2e-5}, {"depth_m": 2e-3}]
    patches = scan(groove, **SMALL)
    for recipe, verdict in (
        ({"inspect": ["coarse"]}, "conform"),
        ({}, "nonconform"),
        ({"inspect": ["fine"]}, "nonconform"),
        ({"exclude": ["coarse"]}, "nonconform"),
        ({"exclude": ["coarse", "fine"]}, "unmeasured"),
    ):
        given = {"least_coverage": 0.1, "regions": regions, "tolerances": tolerances, **recipe}
        known = finished(inspect(patches, **given)[1]).judgement
        assert known.verdict == verdict, (recipe, known.reason)


def test_what_is_too_wide_for_a_finding_is_not_conform() -> None:
    def bent(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return 4e-4 * ((x - 0.008) / 0.008) ** 2 + 0.0 * y

    far, left = {"box_m": [0.5, 0.5, 0.51, 0.51]}, {"box_m": [0, -0.003, 0.008, 0.003]}
    right = {"box_m": [0.008, -0.003, 0.016, 0.003]}
    wide = {"depth_m": 1e-3}
    patches = scan(bent, **SMALL)
    for recipe, verdict in (
        ({}, "inconclusive"),
        ({"reference": "nominal:polynomial2"}, "conform"),
        ({"tolerances": [wide]}, "conform"),
        # Each holds where it holds, for what it limits.
        ({"tolerances": [{"kind": "scratch", "length_m": 1e-3}]}, "inconclusive"),
        ({"tolerances": [{"kind": "scratch", **wide}]}, "inconclusive"),
        (
            {"regions": {"a": far}, "exclude": ["a"], "tolerances": [{"region": "a", **wide}]},
            "inconclusive",
        ),
        ({"regions": {"a": left}, "tolerances": [{"region": "a", **wide}]}, "inconclusive"),
        (
            {
                "regions": {"a": left, "b": right},
                "tolerances": [{"region": name, **wide} for name in "ab"],
            },
            "conform",
        ),
        ({"tolerances": [{"length_m": 1e-3}, wide]}, "conform"),
    ):
        known = finished(inspect(patches, **recipe)[1]).judgement
        assert known.verdict == verdict, known.reason
        assert ("100 µm off the reference" in known.reason) == (verdict == "inconclusive")


def test_a_golden_part_and_what_differs_from_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    good = finished(inspect(scan(flat, **SMALL, seed=1))[1]).found.height_map
    assert good is not None
    (tmp_path / "good").mkdir()
    good.save(tmp_path / "good" / "height_map.npz")
    taught = tmp_path / "golden part"
    assert main(["inspect", "teach", str(tmp_path / "good"), "--output", str(taught)]) == 0
    assert f"--reference 'golden:{taught}'" in capsys.readouterr().out  # to be pasted
    (tmp_path / "good" / "inspection.json").write_text('{"faults": ["poses are missing"]}')
    assert main(["inspect", "teach", str(tmp_path / "good"), "--output", str(taught) + "2"]) == 1
    assert "a scan with faults: poses are missing" in capsys.readouterr().err
    golden = {"reference": f"golden:{taught}"}
    known = finished(inspect(scan(HOLE, **SMALL), **golden)[1]).judgement
    assert known.verdict == "nonconform"
    (judged,) = known.findings
    assert judged.finding.kind == "missing"
    far = scan(flat, **SMALL, start=(1.0, 0.0))
    known = finished(inspect(far, **golden)[1]).judgement
    assert known.verdict in ("inconclusive", "unmeasured")
    assert "golden" in known.reason


def test_measures_of_the_recipe_count() -> None:
    regions = {"hole": {"circle_m": [0.008, 0, 0.0014]}, "all": {"box_m": [0, -0.01, 0.1, 0.01]}}
    lines = {"across": [[0.008, -0.0025], [0.008, 0.0025]]}
    common = {"tolerances": [{"depth_m": 0.01}], "regions": regions, "lines": lines}

    def measured(**measure: Any) -> Any:
        entry = {"name": "m", **measure}
        return finished(inspect(scan(HOLE, **SMALL), **common, measures=[entry])[1]).judgement

    known = measured(tool="depth", of="hole", datum="all", low=-5e-4, high=-1e-4)
    assert (known.verdict, len(known.figures)) == ("conform", 1)
    assert known.figures[0].value == pytest.approx(-3e-4, abs=6e-5)
    known = measured(tool="depth", of="across", low=-1e-4)
    assert known.verdict == "nonconform"
    assert "1 of 1 measures out of tolerance" in known.reason
    known = measured(tool="roughness_sq", of="all", high=1e-9)
    assert known.verdict in ("inconclusive", "nonconform")


def test_a_measure_without_limits_has_no_verdict() -> None:
    regions = {"all": {"box_m": [0, -0.01, 0.1, 0.01]}}
    entry = {"name": "sq", "tool": "roughness_sq", "of": "all"}
    for limits, verdicts in (({}, {None}), ({"high": 1e-3}, {"conform", "unmeasured"})):
        stage, results = inspect(scan(HOLE, **SMALL), regions=regions, measures=[entry | limits])
        document = inspection_document(finished(results), stage.recipe, Scan())
        (measure,) = document["measures"]
        assert measure["verdict"] in verdicts


def test_texture_is_of_what_was_measured_whatever_it_is_compared_with() -> None:
    part = Coverage(0.1, 0.15, 0.75, 1e-4, 40.0, 0.5, 0.3)
    found = texture(part, 1e-4, 10**6, 5e-5)
    assert found["sufficient"]
    assert found["measured"] == pytest.approx(0.6)
    assert texture(replace(part, seen=0.05), 1e-4, 10**6, 5e-5)["measured"] == pytest.approx(0.1)
    assert "Too little texture" in texture(replace(part, seen=0.05), 1e-4, 10**6, 5e-5)["text"]
    # Many events and hardly a cell: not the coating is to blame.
    unsure = texture(replace(part, seen=0.001), 1e-4, 10**6, 5e-5)["text"]
    assert "depths are too uncertain: inspect with surface or focus" in unsure


def test_a_scan_that_broke_off_says_nothing_of_its_coating() -> None:
    """Its events are of more than what was measured until then."""
    found = texture(Coverage(0.05, 0.1, 0.85, 1e-4, 40.0), 1e-4, 10**6, 1e-5, faulty=True)
    assert found["events_per_mm2"] is None
    assert "The scan had faults: 5.0% of the cells measured" in found["text"]
    assert "coating" not in found["text"]
    nothing = texture(Coverage(), 1e-4, 10**6, 0.0, faulty=True)
    assert "before anything was measured" in nothing["text"]


def test_measures_are_printed_in_mm_and_µm_with_their_unit() -> None:
    def words(**changed: Any) -> tuple[str, str, str]:
        m = {"value": -4.08e-5, "uncertainty": 2.7e-5, "unit": "m", "low": -5e-5, "high": None}
        return measure_words({**m, "verdict": "conform", **changed})

    assert words() == ("−40.8 ± 27.0 µm", "−50.0 … – µm", "conform")
    assert words(high=2e-3)[:2] == ("−0.041 ± 0.027 mm", "−0.050 … +2.000 mm")
    assert words(unit="m²", value=2.5e-6, uncertainty=1e-7)[0] == "+2.500 ± 0.100 mm²"
    # What has no limits is reported alone.
    assert words(low=None, value=None, uncertainty=None) == ("–", "–", "–")
