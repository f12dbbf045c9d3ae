"""`roller calibrate` with sphere, plate, caliper and poses: files, refusals, interruptions."""

from pathlib import Path
from typing import Any

import pytest
import yaml

from calibration.scans import ROLLING, sphere_pass, write_scan
from roller_bringup.cli import main
from roller_calibration import grid_search as search
from roller_calibration import grids
from roller_calibration.recordings import Scan
from roller_core.calibration_file import read_record
from roller_core.camera import Camera
from roller_core.parameter_files import read_parameters
from roller_inspect.pipeline import PipelineSettings

#: Dots are as bright as dots are: votes are scaled by their own extremes.
PARAMETERS = {"paper": {"full_scale_votes": 0.0}}


def write_parameters(path: Path, **sections: dict[str, Any]) -> Path:
    nodes = {node: {"ros__parameters": values} for node, values in sections.items()}
    path.write_text(yaml.safe_dump(nodes))
    return path


def calibrate(world: Path, name: str, *more: str, camera: str = "camera.yaml") -> int:
    words = ["calibrate", "sphere", str(world / name), "--radius-mm", "4"]
    words += ["--camera", str(world / camera)]
    if "--params" not in more:
        words += ["--params", str(world / "params.yaml")]
    return main([*words, *more])


def test_sphere_gives_the_nodes_parameters_and_an_account(
    world: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "cell" / "skin.yaml"
    assert calibrate(world, "pass", "-o", str(file), "--skin", "A 7") == 0
    said = capsys.readouterr().out
    assert "before: paper.threshold_c 16" in said
    assert "% of the contact circle" in said
    assert "mm/px at the contact circle" in said
    settings = PipelineSettings.load(file, "bma").depth
    found = read_parameters(file, "emvs")["paper"]
    assert {"threshold_c", "median_px", "weights"} <= found.keys()
    # What the parameter file said stays in force.
    assert settings.paper.full_scale_votes == 0.0
    assert sum(settings.paper.weights) == pytest.approx(1, abs=1e-5)
    account = read_record(file, "sphere")
    assert account is not None
    assert account["skin"] == "A 7"
    assert account["data"] == ["pass"]
    assert len(account["sha256"][0]) == 64
    assert account["camera"]["width"] == ROLLING.width
    assert account["after"]["error_m"] < account["before"]["error_m"]
    assert account["after"]["coverage"] >= account["before"]["coverage"]
    assert list(file.parent.iterdir()) == [file]

    # The same skin again: nothing moves, and the error is that of the file.
    assert calibrate(world, "pass", "--previous", str(file), "--skin", "B") == 0
    said = capsys.readouterr().out
    assert "another skin: 'A 7' then, 'B' now" in said
    assert f"paper.threshold_c: {found['threshold_c']:g} -> {found['threshold_c']:g}" in said
    then = account["after"]
    assert f"{then['error_m'] * 1e6:.1f} µm at {then['coverage']:.1%} then" in said

    # With another camera the file is of no use, to a calibration or to a replay.
    for words in (["--previous", str(file)], ["--params", str(file)]):
        assert calibrate(world, "pass", *words, camera="other.yaml") == 1
        assert "calibrated with another camera" in capsys.readouterr().err
    words = ["replay", str(world / "pass"), "--output", str(tmp_path / "result")]
    words += ["--camera", str(world / "other.yaml"), "--params", str(file)]
    assert main(words) == 1
    assert "calibrated with another camera" in capsys.readouterr().err


def test_focus_has_parameters_of_its_own(
    world: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    grid = grids.focus_grid((4.0, 5.0), (0.4, 0.5))
    monkeypatch.setattr(search, "focus_grid", lambda: grid)
    file = tmp_path / "focus.yaml"
    assert calibrate(world, "pass", "--method", "focus", "-o", str(file)) == 0
    found = read_parameters(file, "emvs")
    assert found.keys() == {"focus", "paper", "calibrated_camera"}
    assert {f"focus.{name}" for name in found["focus"]} == set(search.NAMES["focus"])
    account = read_record(file, "sphere")
    assert account is not None
    assert account["after"]["error_m"] <= account["before"]["error_m"]


@pytest.mark.parametrize(
    ("name", "more", "says"),
    [
        ("plate", [], "no sphere of about 4 mm radius"),
        ("few", [], "too few events"),
        ("beside", [], "middle of the image"),
        ("pass", ["--radius-mm", "5"], "not 5 mm"),
        ("pass", ["--radius-mm", "-4"], "--radius-mm -4"),
        ("pass", ["--scale-mm-per-px", "0.0422"], "off the camera's calibration"),
        ("pass", ["--top-height-mm", "0.0435"], "is it in millimetres?"),
        ("pass", ["--least-coverage", "0.9"], "no parameters of the grid measure"),
        ("pass", ["--least-coverage", "7"], "expected 0 to 1"),
        ("pass", ["--params", "{simplex}"], "simplex"),
        ("pass", ["--previous", "{params}"], "not a calibration by a sphere"),
        ("missing", [], "there is no such file"),
        ("pass", ["--params", "{blind}"], "no pixel of the contact circle is measured"),
        ("pass", ["--params", "{blind}", "--least-coverage", "0.5"], "the most is"),
    ],
)
def test_what_shows_nothing_is_refused(
    world: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    name: str,
    more: list[str],
    says: str,
) -> None:
    simplex = write_parameters(tmp_path / "simplex.yaml", emvs={"paper.weights": [1.0, 1.0, 1.0]})
    blind = write_parameters(tmp_path / "blind.yaml", emvs={"paper.full_scale_votes": 1e6})
    names = {"simplex": simplex, "params": world / "params.yaml", "blind": blind}
    assert calibrate(world, name, *(word.format(**names) for word in more)) == 1
    error = capsys.readouterr().err
    assert says in error
    assert error.count("\n") == 1


def test_recordings_that_share_a_name_are_two(
    world: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    second = write_scan(tmp_path / "pass", sphere_pass(dots=390))
    first = str(world / "pass")
    words = ["--params", str(world / "params.yaml"), "--camera", str(world / "camera.yaml")]
    words += ["--radius-mm", "4", "--weight-parts", "3"]
    assert main(["calibrate", "sphere", first, first, *words]) == 1
    assert "given twice" in capsys.readouterr().err
    assert main(["calibrate", "sphere", first, str(second), *words]) == 0
    said = capsys.readouterr().out
    assert f"{second}: contact circle" in said
    assert "on recordings that had no say" in said


def test_start_that_the_grid_does_not_better_stays(
    world: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "skin.yaml"
    start = {"threshold_c": 45.0, "median_px": 17, "weights": [0.0, 1.0, 0.0]}
    params = write_parameters(tmp_path / "start.yaml", emvs={"paper": PARAMETERS["paper"] | start})
    # Beyond the range of C there are fewer points, and better ones.
    floor = ["--least-coverage", "0.001", "--weight-parts", "2"]
    assert calibrate(world, "pass", "--params", str(params), *floor, "-o", str(file)) == 0
    found = read_parameters(file, "emvs")["paper"]
    account = read_record(file, "sphere")
    assert account is not None
    assert account["after"]["error_m"] <= account["before"]["error_m"]
    said = capsys.readouterr().out
    assert "the parameters stay" in said
    assert {name: found[name] for name in start} == start


def test_two_cameras_are_not_one(
    world: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    one = sphere_pass()
    other = Scan("other", one.events, Camera(320, 140, 900.0, 900.0, 159.5, 69.5), one.track)
    folder = write_scan(tmp_path / "other", other)
    words = ["calibrate", "sphere", str(world / "pass"), str(folder), "--radius-mm", "4"]
    assert main(words) == 1
    assert "different cameras" in capsys.readouterr().err
