"""Write config/*.yaml from the settings models; tests hold the files to them."""

from __future__ import annotations

from pathlib import Path

from roller_braille.braille_stage import BrailleParameters
from roller_core.parameter_files import parameter_file
from roller_core.settings import Settings
from roller_driver.dvxplorer.node_settings import EventCameraParameters
from roller_driver.ur10.robot_settings import Ur10Parameters
from roller_emvs.depth_stage import EmvsParameters
from roller_emvs.stitcher_stage import StitcherParameters
from roller_emvs.surface_stage import SurfaceParameters
from roller_inspect.inspect_stage import InspectParameters
from roller_recording.player_node import PlayerParameters
from roller_recording.writing.recorder_settings import RecorderParameters
from roller_sim.virtual_cell_node import VirtualCellParameters

FILES: dict[str, type[Settings]] = {
    "braille": BrailleParameters,
    "emvs": EmvsParameters,
    "event_camera": EventCameraParameters,
    "inspect": InspectParameters,
    "player": PlayerParameters,
    "recorder": RecorderParameters,
    "stitcher": StitcherParameters,
    "surface": SurfaceParameters,
    "ur10": Ur10Parameters,
    "virtual_cell": VirtualCellParameters,
}


def main() -> None:
    """Write all files."""
    folder = Path(__file__).resolve().parents[1] / "config"
    for node, model in FILES.items():
        (folder / f"{node}.yaml").write_text(parameter_file({node: model}))


if __name__ == "__main__":
    main()
