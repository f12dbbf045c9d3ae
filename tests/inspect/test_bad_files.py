"""Bad datasets, AEDAT4 files, parameters and outputs get one clear line and a non-zero exit."""

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from recording.bags import CAMERA, analytic_dataset, camera_track, write_bag, write_tum
from roller_bringup.cli import main

from .refusing import Capture, assert_matches, refuse, run


def test_missing_input(tmp_path: Path, capsys: Capture) -> None:
    refuse(tmp_path, capsys, tmp_path / "nothing", "there is no such file or folder")
    for name in ("pipe", "pipe.raw"):
        os.mkfifo(tmp_path / name)
        refuse(tmp_path, capsys, tmp_path / name, "neither a file nor a folder")
        assert main(["info", str(tmp_path / name)]) == 1
        assert_matches(capsys.readouterr().err, "neither a file nor a folder")


def test_a_folder_that_can_not_be_read(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    (folder := tmp_path / "folder").mkdir()
    asked = os.access  # permissions don't hold whoever is root
    monkeypatch.setattr(os, "access", lambda path, mode: path != folder and asked(path, mode))
    refuse(tmp_path, capsys, folder, r"folder: can't be read \(Permission denied\)$")


def test_a_folder_that_is_no_bag(tmp_path: Path, capsys: Capture) -> None:
    (tmp_path / "folder").mkdir()
    refuse(tmp_path, capsys, tmp_path / "folder", "no rosbag2 storage")


def test_unwritable_output(tmp_path: Path, capsys: Capture) -> None:
    (tmp_path / "out").write_text("a file is there already")
    refuse(tmp_path, capsys, write_bag(tmp_path / "scan"), "is a file; give another --output")


def test_a_stranger_in_the_output_is_left_alone(tmp_path: Path, capsys: Capture) -> None:
    stranger = tmp_path / "out" / "result"
    stranger.mkdir(parents=True)
    (stranger / "thesis.tex").write_text("years of work")
    refuse(tmp_path, capsys, write_bag(tmp_path / "scan"), "holds files that roller did not write")
    assert (stranger / "thesis.tex").read_text() == "years of work"


def test_a_result_is_never_the_output_of_its_own_replay(tmp_path: Path, capsys: Capture) -> None:
    folder = tmp_path / "out"
    source = write_bag(folder / "result")
    (folder / "notes.txt").write_text("beside it")
    (tmp_path / "link").symlink_to(folder)
    before = {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()}
    for output in (folder, source, source / "new", tmp_path / "link"):
        assert main(["replay", str(source), "--output", str(output), "--no-picture"]) == 1
        (line,) = capsys.readouterr().err.splitlines()
        assert_matches(line, "overlaps with the input")
    assert {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()} == before


def test_a_run_that_can_not_begin_leaves_the_earlier_result(
    tmp_path: Path, capsys: Capture
) -> None:
    assert run(tmp_path, capsys, write_bag(tmp_path / "scan"))[0] == 0
    out = tmp_path / "out"
    before = {file: file.read_bytes() for file in out.rglob("*") if file.is_file()}
    for words in (
        ["replay", str(tmp_path / "nowhere")],
        ["demo", "--scene", "nope"],
        ["simulate", "flat"],  # which replaces nothing, not even of ours
    ):
        assert main([*words, "--output", str(out)]) == 1
        assert len(capsys.readouterr().err.splitlines()) == 1
    assert {file: file.read_bytes() for file in out.rglob("*") if file.is_file()} == before


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("emvs: {ros__parameters: {paper.planes: 1}}", "'paper.planes' = 1"),
        ("emvs: {ros__parameters: {plane: 100}}", "unknown entry 'plane'"),
        ("emvs: {ros__parameters: {depth_min_m: 0.05}}", "depth_min_m"),
        ("emvs: [", "not a YAML file"),
    ],
)
def test_bad_parameters(text: str, message: str, tmp_path: Path, capsys: Capture) -> None:
    params = tmp_path / "bad.yaml"
    params.write_text(text)
    source = write_bag(tmp_path / "scan")
    words = ["replay", str(source), "--output", str(tmp_path / "out"), "--params", str(params)]
    assert main(words) == 1
    assert_matches(capsys.readouterr().err.strip(), message)


@pytest.mark.parametrize(
    ("file", "change", "message"),
    [
        ("events.txt", lambda s: s[:100_000] + "1.0 x 3\n", r"line \d+: expected 't x y p'"),
        ("events.txt", lambda s: s + "0.001 1 1 1\n", "time runs backwards"),
        ("groundtruth.txt", lambda s: s.replace("0 1\n", "0\n", 1), "line 1: 7 fields"),
        ("groundtruth.txt", lambda s: "", "holds no pose"),
        ("calib.txt", lambda s: "800 800\n", "expected 'fx fy cx cy"),
        ("calib.txt", None, "can't be read"),
        ("events.txt", None, "no rosbag2 storage|there is no events.txt"),
    ],
)
def test_bad_dataset(
    file: str,
    change: Callable[[str], str] | None,
    message: str,
    tmp_path: Path,
    capsys: Capture,
) -> None:
    folder = analytic_dataset(tmp_path / "data", 20_000)
    if change is None:
        (folder / file).unlink()
    else:
        (folder / file).write_text(change((folder / file).read_text()))
    refuse(tmp_path, capsys, folder, message)


def test_aedat4_needs_poses_and_camera(tmp_path: Path, capsys: Capture, shared_data: Path) -> None:
    source = shared_data / "aedat4" / "davis346.aedat4"
    refuse(tmp_path, capsys, source, "no poses; give --poses")
    write_tum(camera_track(), tmp_path / "poses.txt")
    given = ["--poses", str(tmp_path / "poses.txt")]
    refuse(tmp_path, capsys, source, "no calibration; give --camera", *given)
    CAMERA.to_yaml(tmp_path / "camera.yaml")
    given += ["--camera", str(tmp_path / "camera.yaml")]
    refuse(tmp_path, capsys, source, "346×260 px but the camera file is for 320×120", *given)


def test_not_an_aedat4_file(tmp_path: Path, capsys: Capture) -> None:
    path = tmp_path / "a.aedat4"
    path.write_bytes(b"nothing of the kind")
    refuse(tmp_path, capsys, path, "not a readable AEDAT4")


def test_truncated_aedat4_keeps_what_came_before(
    tmp_path: Path, capsys: Capture, shared_data: Path
) -> None:
    path = tmp_path / "cut.aedat4"
    shutil.copyfile(shared_data / "aedat4" / "davis346.aedat4", path)
    path.write_bytes(path.read_bytes()[:3_000_000])
    assert main(["info", str(path)]) == 1
    out = capsys.readouterr()
    assert_matches(
        out.err.strip(), r"cut off or broken after 1.\d\d\d s .*; the \d+ events before are read"
    )
    events = int(out.out.split("events")[1].split()[0])
    assert 1000 < events < 78_830
