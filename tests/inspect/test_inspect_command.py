"""`roller inspect` as users meet it: exit codes, one line for what is wrong."""

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from recording.bags import camera_track, write_bag, write_tum
from roller_bringup.cli import main
from roller_core.pose_track import PoseTrack
from roller_core.transforms import matrix_to_quaternion, quaternion_to_matrix

pytestmark = pytest.mark.scan


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Edges on a plane: nearly nothing is measured."""
    return write_bag(tmp_path_factory.mktemp("bag") / "scan")


def test_a_scan_that_shows_little_is_unmeasured(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    words = ["inspect", str(bag), "--output", str(out), "--method", "focus", "--part-id", "P-1"]
    assert main([*words, "--no-picture", "--no-braille"]) == 4
    said = capsys.readouterr()
    assert "P-1: UNMEASURED" in said.out
    (line,) = said.err.strip().splitlines()
    assert line.startswith("unmeasured: ")
    document = json.loads((out / "inspection.json").read_text())
    assert document["verdict"] == "unmeasured"
    assert document["texture"]["sufficient"] is False
    assert document["traceability"]["recording_sha256"]
    files = {path.name for path in out.iterdir()}
    assert files >= {
        "height_map.npz", "height_map.png", "height_map.png.json", "inspection.json",
        "inspection.html", "findings.csv", "surface.ply", "report.json", "result",
    }  # fmt: skip


def test_the_recipe_of_the_parameter_file_counts_unless_one_is_given(
    bag: Path, tmp_path: Path
) -> None:
    """The node takes it from there, so the same part had two verdicts."""
    for name in ("cell", "given"):
        (tmp_path / f"{name}.yaml").write_text(f"name: {name}\n")
    params = tmp_path / "params.yaml"
    params.write_text(f"inspect:\n  ros__parameters: {{recipe: {tmp_path}/cell.yaml}}\n")
    words = ["--params", str(params), "--method", "focus", "--no-picture", "--no-braille"]
    for given, counts in ((["--recipe", str(tmp_path / "given.yaml")], "given"), ([], "cell")):
        main(["inspect", str(bag), "--output", str(tmp_path / "out"), *words, *given])
        document = json.loads((tmp_path / "out" / "inspection.json").read_text())
        assert document["recipe"]["name"] == counts


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--recipe", "{tmp}/none.yaml"], "none.yaml"),
        (["--recipe", "{tmp}/recipe.yaml"], "names 'rim', which is not there"),
        (
            ["--reference", "silver:x"],
            "error: --reference: 'reference' = 'silver:x': is not one of",
        ),
        (["--reference", "golden:{tmp}"], "has no golden.npz"),
        (["--reference", "golden:{tmp}/none"], "no such folder"),
        (["--reference", "cad:{tmp}/recipe.yaml"], "no triangles in it"),
        (
            ["--reference", "cad:{tmp}/mm.obj"],
            "mm.obj: the model is 60 m long; is it in millimetres? Models are in metres: scale it",
        ),
        (["--export", "x3p,stl"], "'stl' is not one of"),
    ],
)
def test_wrong_usage_is_one_line_and_leaves_nothing(
    words: list[str], said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "recipe.yaml").write_text("inspect: [rim]\n")
    (tmp_path / "mm.obj").write_text("v 0 0 0\nv 60 0 0\nv 0 20 1\nf 1 2 3\n")
    given = [word.format(tmp=tmp_path) for word in words]
    try:
        code = main(["inspect", str(tmp_path / "bag"), "--output", str(tmp_path / "out"), *given])
    except SystemExit as error:  # argparse
        code = int(error.code or 0)
    assert code == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("turned_over", [False, True])
def test_poses_by_which_the_camera_looks_up_give_no_verdict(
    turned_over: bool, bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As those in a frame of the first camera: dents would pass for rises."""
    track, poses = camera_track(), tmp_path / "poses.txt"
    if turned_over:
        over = np.diag([1.0, -1.0, -1.0])
        turned = [matrix_to_quaternion(over @ quaternion_to_matrix(q)) for q in track.quaternions]
        down = PoseTrack()
        down.extend(track.times_ns, track.positions @ over, np.array(turned))
        track = down
    write_tum(track, poses)
    words = ["inspect", str(bag), "--output", str(tmp_path / "out"), "--poses", str(poses)]
    code = main([*words, "--method", "focus", "--no-picture", "--no-braille"])
    said = capsys.readouterr().err
    assert ("the camera looks up, along +z of base" in said) != turned_over
    assert code == (4 if turned_over else 1)


def test_a_later_replay_leaves_no_verdict_of_another_scan(bag: Path, tmp_path: Path) -> None:
    for command in ("inspect", "replay"):
        words = [command, str(bag), "--output", str(tmp_path / "out"), "--method", "focus"]
        main([*words, "--no-picture", "--no-braille"])
        kept = (tmp_path / "out" / "inspection.json").exists()
        assert kept == (command == "inspect")


def test_whoever_reads_may_go_and_the_results_stay(bag: Path, tmp_path: Path) -> None:
    """As `roller inspect ... | head -1` does: it cost a whole inspection."""
    words = ["inspect", str(bag), "--output", str(tmp_path / "out"), "--no-picture", "--no-braille"]
    command = [sys.executable, "-m", "roller_bringup.cli", *words, "--method", "focus"]
    # What it says is kept back until it ends, as in most shells.
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONUNBUFFERED"}
    with subprocess.Popen(command, stdout=subprocess.PIPE, env=environment) as process:
        assert process.stdout is not None
        process.stdout.close()
        assert process.wait() == 141
    assert json.loads((tmp_path / "out" / "inspection.json").read_text())["verdict"]
