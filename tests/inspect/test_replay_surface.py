"""A replay by the sweep in the surface's frame: a surface, and no depth maps."""

import json
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag2 import Reader

from emvs.scenes import tilted
from recording.bags import write_bag
from roller_bringup.cli import main
from roller_core.camera import Camera
from roller_core.errors import SettingsError
from roller_core.pose_track import PoseTrack
from roller_emvs.depth_settings import DepthSettings
from roller_emvs.pipeline import DepthPipeline
from roller_emvs.ply import read_ply
from roller_inspect.pipeline import PipelineSettings

PARAMS = """
emvs:
  ros__parameters: {depth_max_m: 0.0475, threads: 1}
surface:
  ros__parameters: {evidence: {sigma_px: 4.0}, min_aperture_m: 0.009}
"""


def test_a_surface_is_written(tmp_path: Path) -> None:
    params, output = tmp_path / "params.yaml", tmp_path / "out"
    params.write_text(PARAMS)
    code = main(
        [
            "replay", str(write_bag(tmp_path / "scan")), "--output", str(output),
            "--params", str(params), "--method", "surface",
        ]
    )  # fmt: skip
    assert code == 0
    assert (output / "overview.png").stat().st_size > 20_000
    ply = read_ply(output / "surface.ply")
    assert len(ply["x"]) > 200
    assert np.median(np.abs(ply["z"] - tilted(ply["x"]))) < 150e-6
    with Reader(output / "result") as reader:
        counts = {c.topic: c.msgcount for c in reader.connections}
    assert counts.get("/roller/surface/points", 0) > 0
    assert not counts.get("/roller/depth/image")
    report = json.loads((output / "report.json").read_text())
    assert report["method"] == "surface"
    assert report["settings"]["surface"]["depth_max_m"] == 0.0475
    assert sum(w["points"] for w in report["windows"]) == len(ply["x"])
    assert report["totals"]["depth_windows"] > 0


def test_other_sections_say_what_is_shared(tmp_path: Path) -> None:
    (tmp_path / "p.yaml").write_text(PARAMS)
    settings = PipelineSettings.load(tmp_path / "p.yaml").surface
    assert (settings.depth_max_m, settings.threads, settings.evidence.sigma_px) == (0.0475, 1, 4.0)


def test_inspection_takes_points_as_found_unless_a_file_says_otherwise(tmp_path: Path) -> None:
    """As the graph does: what its parameter file sets counts more than `inspect:=true`."""
    file = tmp_path / "p.yaml"
    for text, averaged in (("{threads: 1}", False), ("{average_flats: true}", True)):
        file.write_text(f"emvs:\n  ros__parameters: {text}\n")
        settings = PipelineSettings.load(file).for_inspection()
        assert settings.depth.average_flats is settings.surface.average_flats is averaged
    file.write_text("surface:\n  ros__parameters: {average_flats: true}\n")
    settings = PipelineSettings.load(file).for_inspection()
    assert (settings.depth.average_flats, settings.surface.average_flats) == (False, True)


def test_its_gap_between_poses_counts_where_it_is_the_method(tmp_path: Path) -> None:
    file = tmp_path / "p.yaml"
    file.write_text("surface:\n  ros__parameters: {max_pose_gap_s: 0.02, idle_flush_s: 2.0}\n")
    assert PipelineSettings.load(file, "surface").max_pose_gap_s == 0.02
    assert PipelineSettings.load(file).max_pose_gap_s == 0.1


def test_it_makes_no_depth_maps() -> None:
    with pytest.raises(SettingsError, match="a node of its own, 'surface'"):
        DepthPipeline(
            DepthSettings(method="surface"), Camera(8, 8, 8.0, 8.0, 3.5, 3.5), PoseTrack()
        )
