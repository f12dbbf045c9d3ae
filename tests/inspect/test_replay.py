"""Replay: what it writes, and inputs that are no bags (tests/recording has all kinds of those)."""

import json
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import Reader, StoragePlugin, Writer

from emvs.scenes import CAMERA, tilted
from recording.bags import (
    analytic_dataset,
    camera_track,
    read_messages,
    scan,
    write_bag,
    write_messages,
    write_tum,
)
from recording.event_files import write_aedat4
from roller_bringup.cli import main
from roller_bringup.view.recorded import results_of
from roller_core.errors import RollerError
from roller_emvs.ply import read_ply
from roller_inspect.results.recorded import gather
from roller_inspect.results.run_report import Report

PARAMS = """
emvs:
  ros__parameters: {paper: {planes: 60, threshold_c: 6.0, median_px: 9, full_scale_votes: 0.0},
                    window: {time_s: 0.03, travel_m: 0.006}, focus: {sigma_px: 3.0}}
"""


#: Where the replay of the plain bag lies, and its depth maps by time.
Reference = tuple[Path, dict[int, np.ndarray]]


@pytest.fixture(scope="module")
def params(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("params") / "params.yaml"
    path.write_text(PARAMS)
    return path


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_bag(tmp_path_factory.mktemp("bag") / "scan")


def replay(source: Path, output: Path, params: Path, *more: str) -> int:
    return main(
        [
            "replay", str(source), "--output", str(output), "--params", str(params),
            "--no-picture", *more,
        ]
    )  # fmt: skip


def depth_maps(output: Path) -> dict[int, np.ndarray]:
    found = {}
    for log_ns, message in read_messages(output / "result", "/roller/depth/image"):
        assert message.encoding == "32FC1"
        assert message.header.frame_id == "event_camera_optical_frame"
        pixels = np.frombuffer(message.data, np.float32)
        found[log_ns] = pixels.reshape(message.height, message.width)
    return found


@pytest.fixture(scope="module")
def reference(bag: Path, params: Path, tmp_path_factory: pytest.TempPathFactory) -> Reference:
    output = tmp_path_factory.mktemp("reference")
    assert replay(bag, output, params) == 0
    return output, depth_maps(output)


@pytest.mark.parametrize("with_accounts", [True, False])
def test_a_recorded_graph_gives_the_same_windows(
    reference: Reference, tmp_path: Path, with_accounts: bool
) -> None:
    """What each came to is in its account; bags of nodes that gave none hold the points alone."""
    result, bag = reference[0] / "result", tmp_path / "bag"
    with Reader(result) as reader:
        messages = [
            (t_ns, c.topic, c.msgtype, bytes(data))
            for c, t_ns, data in reader.messages()
            if with_accounts or not c.topic.endswith("/account")
        ]
    write_messages(Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP), iter(messages))
    gather(bag, tmp_path, None, Report("a bag", "focus", {}))
    found, expected = (
        json.loads((folder / "report.json").read_text()) for folder in (tmp_path, reference[0])
    )
    measured = [w for w in expected["windows"] if w["points"]]
    assert found["totals"]["depth_windows"] == len(measured)
    if with_accounts:
        assert [w["stamp_ns"] for w in found["windows"]] == sorted(
            w["stamp_ns"] for w in expected["windows"]
        )
        for window in found["windows"]:
            assert window in expected["windows"]
    else:
        assert [(w["stamp_ns"], w["points"]) for w in found["windows"]] == sorted(
            (w["stamp_ns"], w["points"]) for w in measured
        )
        assert not any("cpu_ms" in w or "events" in w for w in found["windows"])


@pytest.mark.parametrize("what", ["namespace", "no metadata", "cut off"])
def test_results_of_other_recordings_are_gathered_too(
    reference: Reference, tmp_path: Path, what: str
) -> None:
    """Of a cell in a namespace, and where the recorder was killed: what came before is there."""
    bag, cell = tmp_path / "bag", "/left" if what == "namespace" else ""
    with Reader(reference[0] / "result") as reader:
        messages = [
            (t_ns, cell + c.topic, c.msgtype, bytes(data)) for c, t_ns, data in reader.messages()
        ]
    write_messages(Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP), iter(messages))
    if what != "namespace":
        (bag / "metadata.yaml").unlink()
    if what == "cut off":
        (file,) = bag.glob("*.mcap")
        file.write_bytes(file.read_bytes()[:-100])
    out = tmp_path / "out"
    out.mkdir()
    assert results_of(bag, out) == out
    found, expected = (
        json.loads((folder / "report.json").read_text()) for folder in (out, reference[0])
    )
    for key in ("depth_windows", "surface_points"):
        assert found["totals"][key] == expected["totals"][key] > 0


def test_results_of_two_cells_in_one_recording_are_not_mixed(
    reference: Reference, tmp_path: Path
) -> None:
    bag = tmp_path / "bag"
    with Reader(reference[0] / "result") as reader:
        messages = [
            (t_ns, cell + c.topic, c.msgtype, bytes(data))
            for c, t_ns, data in reader.messages() for cell in ("/left", "/right")
        ]  # fmt: skip
    write_messages(Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP), iter(messages))
    with pytest.raises(RollerError, match=r"it holds results of 2 cells \(/left, /right\)"):
        results_of(bag, tmp_path)


def test_parameters_given_twice_are_refused(
    bag: Path, params: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["replay", str(bag), "--params", str(params), "--params", str(params)]
    with pytest.raises(SystemExit) as caught:
        main([*words, "--output", str(tmp_path / "out")])
    assert caught.value.code == 2
    assert "--params is given twice" in capsys.readouterr().err


def test_outputs_are_complete(reference: Reference) -> None:
    output, maps = reference
    report = json.loads((output / "report.json").read_text())
    windows = [w for w in report["windows"] if w["points"]]
    assert len(maps) == len(windows) == report["totals"]["depth_windows"] >= 3
    for window in windows:
        assert {"stamp_s", "events", "points", "milliseconds", "lost"} <= set(window)
        assert window["milliseconds"]["total"] > 0
        assert window["cpu_ms"] > 0
    assert report["totals"]["events"] == len(scan())
    assert report["faults"] == []
    assert (output / "braille.txt").read_text() == ""
    assert json.loads((output / "braille.json").read_text())["cells"] == []
    cloud = read_ply(output / "surface.ply")
    assert len(cloud["x"]) == report["totals"]["surface_points"] > 1000
    # Base: the camera looks along +z here, so z is depth.
    error = np.abs(cloud["z"] - tilted(cloud["x"]))
    assert np.median(error) < 1.5e-4
    assert np.all((cloud["confidence"] > 0) & (cloud["confidence"] <= 1))
    assert np.all((cloud["sigma"] > 1e-6) & (cloud["sigma"] < 1e-3))


def test_surface_in_the_bag_equals_the_file(reference: Reference) -> None:
    output, _ = reference
    rows = []
    for _, message in read_messages(output / "result", "/roller/surface/points"):
        assert message.header.frame_id == "base"
        assert [f.name for f in message.fields] == ["x", "y", "z", "height", "confidence", "sigma"]
        rows.append(np.frombuffer(message.data, np.float32).reshape(-1, 6))
    cloud = read_ply(output / "surface.ply")
    np.testing.assert_allclose(np.concatenate(rows)[:, 2], cloud["z"], atol=1e-7)


def test_a_dataset_folder_gives_the_same_depth(
    params: Path, tmp_path: Path, reference: Reference
) -> None:
    folder = analytic_dataset(tmp_path / "dataset")
    CAMERA.to_yaml(tmp_path / "camera.yaml")
    code = replay(folder, tmp_path / "out", params, "--camera", str(tmp_path / "camera.yaml"))
    assert code == 0
    found = list(depth_maps(tmp_path / "out").values())
    for depth, expected in zip(found, reference[1].values(), strict=True):
        same = np.isfinite(depth) == np.isfinite(expected)
        assert same.mean() > 0.995  # as text, poses round otherwise: 0.997 on some processors


def test_aedat4_with_poses_gives_the_same_depth(
    params: Path, tmp_path: Path, reference: Reference
) -> None:
    path = write_aedat4(tmp_path / "scan.aedat4", {"events": 4})
    write_tum(camera_track(), tmp_path / "poses.txt")
    CAMERA.to_yaml(tmp_path / "camera.yaml")
    code = replay(
        path, tmp_path / "out", params,
        "--poses", str(tmp_path / "poses.txt"), "--camera", str(tmp_path / "camera.yaml"),
    )  # fmt: skip
    assert code == 0
    found, expected = depth_maps(tmp_path / "out"), reference[1]
    # A window's stamp is where half of its way lies: poses as text may turn it by a rounding.
    assert list(found) == pytest.approx(list(expected), rel=0, abs=1000)
    for depth, wanted in zip(found.values(), expected.values(), strict=True):
        both = np.isfinite(depth) & np.isfinite(wanted)
        assert both.sum() > 200
        assert np.median(np.abs(depth - wanted)[both]) < 1e-4


def test_methods_are_selectable(bag: Path, params: Path, tmp_path: Path) -> None:
    assert replay(bag, tmp_path / "out", params, "--method", "bma", "--no-braille") == 0
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["method"] == "bma"
    assert "fusion" in next(w for w in report["windows"] if w["points"])["milliseconds"]


def test_drift_that_the_method_does_not_correct_is_not_called_uncalibrated(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    params = tmp_path / "cell.yaml"
    edges = {"coefficients_m": [1e-5, 0.0] * 2, "residual_m": [1e-5] * 24, "max_slope": 1.0}
    drift = f"focus: {{sigma_px: 3.0}}, edge_drift: {edges}"
    params.write_text(PARAMS.replace("focus: {sigma_px: 3.0}", drift))
    for method, said in (("bma", "not corrected by the paper's methods"), ("focus", "calibrated")):
        out = tmp_path / method
        assert replay(bag, out, params, "--method", method, "--no-braille") == 0
        assert json.loads((out / "report.json").read_text())["edge_drift"] == said
        assert ("edge drift: not corrected by" in capsys.readouterr().out) == (method == "bma")


@pytest.mark.recordings
def test_slider_depth(shared_data: Path, tmp_path: Path) -> None:
    """The reference C++ code finds about 2,700 pixels, 2,600 after its outlier filter."""
    config = Path(__file__).resolve().parents[2] / "config" / "slider_depth.yaml"
    code = main(
        [
            "replay", str(shared_data / "slider_depth"), "--output", str(tmp_path),
            "--method", "emvs", "--params", str(config),
        ]
    )  # fmt: skip
    assert code == 0
    depth = next(iter(depth_maps(tmp_path).values()))
    measured = depth[np.isfinite(depth)]
    assert 2300 < len(measured) < 3200
    assert 2200 < len(read_ply(tmp_path / "surface.ply")["x"]) < 3100
    # Planes at separate depths: nothing between the front ones and the poster behind.
    counts, _ = np.histogram(measured, [0.47, 0.8, 1.2, 1.35, 1.6, 1.95, 2.4])
    assert counts[0] > 200
    assert counts[1] > 200
    assert counts[4] + counts[5] > 800
    assert counts[2] < 100
    assert (tmp_path / "overview.png").stat().st_size > 50_000


@pytest.mark.recordings
def test_info_counts_the_recordings(shared_data: Path, capsys: pytest.CaptureFixture[str]) -> None:
    packets = shared_data / "ros_event_packets"
    expected = {
        packets / "test_events_1": "343474 (125183 ON, 218291 OFF)",
        packets / "test_data_mono_cd": "100 (50 ON, 50 OFF)",
        shared_data / "aedat4" / "davis346.aedat4": "78830 (",
    }
    for path, line in expected.items():
        assert main(["info", str(path)]) == 0
        assert line in capsys.readouterr().out
