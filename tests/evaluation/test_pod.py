"""Probability of detection: curves and their bounds, what counts as a hit, what a run writes."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.special import expit, log_expit, logit

from roller_bringup.cli import main
from roller_evaluation.detection import footprint, matched, overlap
from roller_evaluation.pod import PodOptions, draw, pod_cases, summarise, tables
from roller_evaluation.pod_curve import fit_pod, poisson_bound


def tried(rng: np.random.Generator, count: int, a90: float) -> tuple[np.ndarray, np.ndarray]:
    """Targets of 30 to 400 and whether they were found, by a logit of slope 4."""
    sizes = np.exp(rng.uniform(np.log(30), np.log(400), count))
    return sizes, rng.random(count) < expit(logit(0.9) + 4 * np.log(sizes / a90))


def test_a_curve_is_the_logistic_regression() -> None:
    sizes, hits = tried(np.random.default_rng(3), 300, 150.0)

    def misfit(b: np.ndarray) -> float:
        x = b[0] + b[1] * np.log(sizes / 100)
        return -float(np.sum(log_expit(np.where(hits, x, -x))))

    level, slope = minimize(misfit, [0.0, 1.0]).x
    curve = fit_pod(sizes.tolist(), hits.tolist())
    assert curve.a90 == pytest.approx(100 * np.exp((logit(0.9) - level) / slope), rel=1e-3)
    assert curve.slope == pytest.approx(slope, rel=1e-2)
    assert curve.at([curve.a90]) == pytest.approx(0.9)


def test_the_bound_holds_as_often_as_it_says() -> None:
    rng = np.random.default_rng(5)
    held = 0
    for _ in range(30):
        sizes, hits = tried(rng, 80, 150.0)
        curve = fit_pod(sizes.tolist(), hits.tolist())
        assert curve.a90_95 is None or curve.a90_95 >= (curve.a90 or 0)
        held += curve.a90_95 is None or curve.a90_95 >= 150.0
    # Fewer than 25 would come of a true 95 % once in a thousand times.
    assert held >= 25


def test_what_the_targets_do_not_show_is_not_reached() -> None:
    sizes = np.geomspace(30, 400, 60).tolist()
    none, every = fit_pod(sizes, [False] * 60), fit_pod(sizes, [True] * 60)
    assert (none.a90, none.a90_95) == (None, None)
    assert every.a90 is not None
    assert every.a90 <= 30
    assert every.a90_95 is not None
    assert every.a90_95 < 60
    # Four in five are found, whatever their size.
    some = fit_pod(sizes, [k % 5 != 0 for k in range(60)])
    assert some.a90_95 is None
    with pytest.raises(ValueError, match="needs targets"):
        fit_pod([], [])


def test_poisson_bounds_are_those_of_tables() -> None:
    assert poisson_bound(0, 1.0) == pytest.approx(2.9957, abs=1e-3)
    assert poisson_bound(3, 2.0) == pytest.approx(7.7537 / 2, abs=1e-3)
    assert poisson_bound(1, 0.0) == np.inf


@dataclass(frozen=True)
class Made:
    """What of a finding is matched."""

    outline_m: np.ndarray
    depth_m: float = -1e-4


def square(x_mm: float, y_mm: float, side_mm: float) -> np.ndarray:
    corners = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]])
    return (np.array([x_mm, y_mm]) + corners * side_mm) * 1e-3


def test_outlines_share_what_they_share() -> None:
    one = square(0, 0, 2)
    assert overlap(one, square(1, 1, 2)) == pytest.approx(1e-6, rel=0.15)
    assert overlap(one, square(2.3, 0, 2)) == 0
    assert overlap(one, square(2.3, 0, 2), 5e-4) > 0
    assert footprint(one) == pytest.approx(4e-6, rel=0.06)
    turned = one @ np.array([[0.8, 0.6], [-0.6, 0.8]])
    assert overlap(one, turned) == pytest.approx(overlap(turned, one), rel=0.05)


def test_findings_hit_what_they_overlap_most() -> None:
    marks = [square(0, 0, 2), square(5, 0, 2)]
    near, far = Made(square(2.2, 0, 0.5)), Made(square(20, 0, 1))
    shallow, deep = Made(square(0.5, 0.5, 0.3), -5e-5), Made(square(1, 1, 1), -2e-4)
    wide, on_rivet = Made(square(1.5, 0, 5)), Made(square(10, 0, 1))
    rivets = [square(9, -1, 3)]
    hits, false_calls = matched([near, far, shallow, deep, on_rivet], marks, rivets)
    assert hits == {0: deep}
    assert false_calls == [far]
    assert matched([wide], marks)[0] == {1: wide}
    assert matched([far], []) == ({}, [far])


def made_up(finds_from_um: float) -> list[dict[str, Any]]:
    """Rows of an inspection that finds what is deep enough, 10 µm too deep."""
    rows: list[dict[str, Any]] = []
    for case in pod_cases(PodOptions(plates=2, clean=1, speeds=(0.3,))):
        columns = case.columns
        plate = {"role": "plate", "false_calls": 1, "area_m2": 1e-3, "measured": 0.6,
                 "continued": 0.2}  # fmt: skip
        rows.append(columns | plate)
        if columns["scene"] == "clean":
            continue
        for depth in np.repeat(np.geomspace(30, 400, 12), 3).tolist():
            for kind in ("dent", "extra"):
                sign = 1 if kind == "extra" else -1
                row = {"role": "defect", "kind": kind, "depth_um": sign * depth,
                       "skin_um": sign * depth, "length_mm": 3.0, "width_mm": 2.0}  # fmt: skip
                row["hit"] = depth >= finds_from_um and columns["coating"] == "textured"
                if row["hit"]:
                    row |= {"found_kind": "dent", "found_depth_um": sign * (depth + 10),
                            "found_length_mm": 3.1, "found_width_mm": 2.0,
                            "u_depth_um": 9.0, "u_length_mm": 0.2, "u_width_mm": 0.2}  # fmt: skip
                rows.append(columns | row)
    return rows


def test_tables_say_what_was_found_and_what_was_not_reached(tmp_path: Path) -> None:
    rows = made_up(100.0)
    found = summarise(rows)
    result = {"rows": rows, "facts": {"seeds": "1 to 3"}, **found}
    curves, by_depth, calls = tables(json.loads(json.dumps(result)))
    cells = {row[:2]: row for row in curves.rows}
    textured, plain = cells["textured, 0.3", "all"], cells["plain, 0.3", "all"]
    # Of the depths, 97 µm is missed and 122 found.
    assert 97 <= float(textured[3]) <= 123
    assert float(textured[3]) <= float(textured[4]) <= 150
    # A lump found too high and a dent found too deep: 10 µm each, without bias on the whole.
    assert textured[5:8] == ("10", "0", "0%")
    assert cells["textured, 0.3", "dent"][10:] == ("100%", "100%")
    assert cells["textured, 0.3", "extra"][11] == "–"
    assert plain[2:5] == ("0 of 144", "not reached", "not reached")
    assert by_depth.rows[0][1] == "0%"
    assert by_depth.rows[0][-1] == "100%"
    assert calls.rows[0][1:6] == ("3", "3000", "1000", "2585", "1 on 1000 mm²")
    assert all("not fitted to a real roller" in table.note for table in (curves, calls))
    draw(rows, tmp_path / "pod.png")
    assert (tmp_path / "pod.png").stat().st_size > 20_000


def test_reports_use_other_plates_than_tuning() -> None:
    report = {case.scan.seed for case in pod_cases(PodOptions())}
    tuning = {case.scan.seed for case in pod_cases(PodOptions(seed=1))}
    assert not report & tuning
    scenes = [case.scan.settings().scene for case in pod_cases(PodOptions(speeds=(0.3,)))]
    textured, plain = scenes[: len(scenes) // 2], scenes[len(scenes) // 2 :]
    # The same plates under each coating, no two alike.
    assert textured == plain
    assert len({scene.seed for scene in textured}) == len(textured)


def test_a_run_inspects_plates_and_writes_its_files(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "pod"
    assert main(["evaluate", "pod", "--quick", "--jobs", "1", "--output", str(output)]) == 0
    shown = capsys.readouterr().out
    for words in ("not fitted to a real roller", "Probability of detection", "False calls"):
        assert words in shown
    result = json.loads((output / "pod.json").read_text(), parse_constant=pytest.fail)
    plates = [r for r in result["rows"] if r["role"] == "plate"]
    assert [r["scene"] for r in plates] == ["defects", "clean"]
    # Of three slots side by side the view takes in the middle one, over 14 mm.
    assert 5e-5 < plates[1]["area_m2"] < 8e-5
    assert 3e-5 < plates[0]["area_m2"] < plates[1]["area_m2"]
    assert sum(r["role"] == "defect" for r in result["rows"]) in (1, 2)
    assert (output / "rows.csv").is_file()
    assert (output / "pod.png").is_file()


def test_wrong_options_get_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["evaluate", "pod", "--coatings", "golden"]) == 1
    assert "'golden' is none of plain, textured" in capsys.readouterr().err
    assert main(["evaluate", "pod", "--kinds", "hole"]) == 1
    assert "--kinds: 'hole' is none of dent, crater" in capsys.readouterr().err
    assert main(["evaluate", "pod", "--depths-mm", "5", "--output", str(tmp_path / "pod")]) == 1
    assert "at most 1.5 is expected" in capsys.readouterr().err
