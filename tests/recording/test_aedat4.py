"""AEDAT4 files with poses: cut off, with several streams, with poses of another clock."""

import json
import re
from pathlib import Path

import pytest

from emvs.scenes import tilted
from recording.bags import CAMERA, camera_track, scan, write_tum
from recording.event_files import write_aedat4
from roller_bringup.cli import main
from roller_emvs.ply import read_ply

Capture = pytest.CaptureFixture[str]
PARAMS = "emvs: {ros__parameters: {window.travel_m: 0.006, focus.sigma_px: 3.0}}"


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_aedat4(tmp_path_factory.mktemp("aedat4") / "scan.aedat4", {"events": 4})


def replay(source: Path, folder: Path, *more: str) -> int:
    write_tum(camera_track(), folder / "poses.txt")
    CAMERA.to_yaml(folder / "camera.yaml")
    (folder / "params.yaml").write_text(PARAMS)
    words = ["replay", str(source), "--output", str(folder / "out"), "--no-picture"]
    words += ["--poses", str(folder / "poses.txt"), "--camera", str(folder / "camera.yaml")]
    return main([*words, "--params", str(folder / "params.yaml"), *more])


def test_a_file_cut_off_is_replayed_up_to_the_cut(
    file: Path, tmp_path: Path, capsys: Capture
) -> None:
    cut = tmp_path / "cut.aedat4"
    cut.write_bytes(file.read_bytes()[: int(file.stat().st_size * 0.75)])
    assert replay(cut, tmp_path) == 1
    (line,) = capsys.readouterr().err.splitlines()
    found = re.search(r"cut off or broken after 0.0(\d\d) s .*; the (\d+) events before", line)
    assert found, line
    assert 40 < int(found[1]) < 70
    totals = json.loads((tmp_path / "out" / "report.json").read_text())["totals"]
    assert totals["events"] == int(found[2])
    assert totals["depth_windows"] >= 1
    cloud = read_ply(tmp_path / "out" / "surface.ply")
    assert len(cloud["x"]) > 100
    assert abs(float((cloud["z"] - tilted(cloud["x"])).mean())) < 5e-4


def test_a_file_cut_anywhere_gets_one_line(file: Path, tmp_path: Path, capsys: Capture) -> None:
    whole = file.read_bytes()
    counts = []
    for share in (0.0, 0.0005, 0.01, 0.2, 0.5, 0.8):
        path = tmp_path / "cut.aedat4"
        path.write_bytes(whole[: int(share * len(whole))])
        assert main(["info", str(path)]) == 1
        out, err = capsys.readouterr()
        assert err.count("error: ") == err.count("\n") == 1
        found = re.search(r"events     (\d+) ", out)
        counts.append(int(found[1]) if found else 0)
    assert counts == sorted(counts)
    assert counts[-1] > counts[-2] > 1000


def test_several_streams_need_a_choice(tmp_path: Path, capsys: Capture) -> None:
    path = write_aedat4(tmp_path / "two.aedat4", {"left": 100, "right": 400})
    assert main(["info", str(path)]) == 1
    assert "several event streams; choose with --topic: 0, 1" in capsys.readouterr().err
    assert main(["info", str(path), "--topic", "1"]) == 0
    assert f"events     {-(-len(scan()) // 400)} (" in capsys.readouterr().out
    assert replay(path, tmp_path, "--topic", "2") == 1
    assert "stream 2 is none of events; those are 0, 1" in capsys.readouterr().err


def test_poses_of_another_clock_are_reported(file: Path, tmp_path: Path, capsys: Capture) -> None:
    assert replay(file, tmp_path, "--poses", str(sensor_time_poses(tmp_path))) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert "no event lies within the poses" in line
    assert "are they in the same clock?" in line


def sensor_time_poses(folder: Path) -> Path:
    path = folder / "other.txt"
    path.write_text("".join(f"{k * 0.008} {k * 0.001} 0 0 0 0 0 1\n" for k in range(100)))
    return path
