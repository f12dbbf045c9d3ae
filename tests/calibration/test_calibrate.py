"""`roller calibrate`: from recordings to a file that the nodes and a replay take."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from calibration.bidirectional_scan import CAMERA, scan_of, there_and_back
from roller_bringup.cli import main
from roller_core.calibration_file import read_account
from roller_inspect.pipeline import InspectionSettings


def recording(folder: Path, speed_m_s: float, delay_s: float) -> Path:
    """A scan as a folder of the public event-camera dataset."""
    scan = scan_of(there_and_back(speed_m_s), delay_s)
    folder.mkdir()
    e, track = scan.events, scan.track
    rows = np.column_stack([e.t_ns * 1e-9, e.x, e.y, e.p])
    np.savetxt(folder / "events.txt", rows, fmt="%.9f %d %d %d")
    track.write_tum(folder / "groundtruth.txt")
    c = CAMERA
    (folder / "calib.txt").write_text(f"{c.fx} {c.fy} {c.cx} {c.cy} 0 0 0 0 0\n")
    return folder


def test_two_scans_give_the_nodes_their_delay(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scans = [str(recording(tmp_path / f"{v}", v, 0.0012)) for v in (0.1, 0.25)]
    camera = tmp_path / "camera.yaml"
    CAMERA.to_yaml(camera)
    file = tmp_path / "cell" / "delay.yaml"
    words = ["calibrate", "--time-offset", *scans, "-o", str(file), "--camera", str(camera)]
    assert main(words) == 0
    assert "lag the poses by 1." in capsys.readouterr().out
    settings = InspectionSettings.load(file)
    for part in (settings.depth, settings.surface, settings.braille):
        assert part.event_delay_s == pytest.approx(0.0012, abs=5e-5)


def test_one_scan_says_what_its_delay_holds(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    scan = recording(tmp_path / "scan", 0.2, 0.001)
    camera = tmp_path / "camera.yaml"
    CAMERA.to_yaml(camera)
    assert main(["calibrate", "--time-offset", str(scan), "--camera", str(camera)]) == 0
    assert "give another recording" in capsys.readouterr().out


def test_subcommand_is_the_option_and_carries_parameters_over(tmp_path: Path) -> None:
    scan = str(recording(tmp_path / "scan", 0.2, 0.001))
    camera, params = tmp_path / "camera.yaml", tmp_path / "params.yaml"
    CAMERA.to_yaml(camera)
    params.write_text("emvs: {ros__parameters: {paper.threshold_c: 9.0, event_delay_s: 0.05}}")
    files = [tmp_path / "one.yaml", tmp_path / "two.yaml"]
    for words, file in zip((["--time-offset", scan], ["time-offset", scan]), files, strict=True):
        given = ["--camera", str(camera), "--params", str(params), "-o", str(file)]
        assert main(["calibrate", *words, *given]) == 0
    one, two = (InspectionSettings.load(file).depth for file in files)
    assert one == two
    assert one.paper.threshold_c == 9.0
    assert one.event_delay_s == pytest.approx(0.001, abs=4e-4)
    account = read_account(files[0], "time_offset")
    assert account is not None
    assert account["data"] == ["scan"]


def test_what_to_calibrate_must_be_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as fault:
        main(["calibrate", str(tmp_path)])
    assert fault.value.code == 2
    assert "sphere" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["--time-offset", "{missing}"], "there is no such file"),
        (["--time-offset", "{scan}", "{scan}", "--poses", "p.txt"], "goes with one recording"),
        (["--time-offset", "{scan}", "-o", "/proc/none/delay.yaml"], "can't be written"),
    ],
)
def test_faults_are_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], words: list[str], says: str
) -> None:
    names = {
        "scan": str(recording(tmp_path / "scan", 0.2, 0.0)),
        "missing": str(tmp_path / "missing"),
    }
    camera = tmp_path / "camera.yaml"
    CAMERA.to_yaml(camera)
    given = [w.format(**names) for w in words]
    assert main(["calibrate", *given, "--camera", str(camera)]) == 1
    told = capsys.readouterr().err.strip().splitlines()
    assert len(told) == 1
    assert told[0].startswith("error: ")
    assert says in told[0]
