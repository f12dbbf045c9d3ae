"""Options that several commands have in common."""

from __future__ import annotations

import argparse
from pathlib import Path


def add_written_options(parser: argparse.ArgumentParser, skin: bool = False) -> None:
    """Add what is said of the parameter file that a calibration writes.

    Parameters
    ----------
    parser : ArgumentParser
        Parser of the command.
    skin : bool
        Whether what is found belongs to a skin.
    """
    parser.add_argument(
        "--output", "-o", type=Path, metavar="FILE", help="ROS 2 parameter file to write"
    )
    if skin:
        parser.add_argument(
            "--skin", default="", metavar="NAME", help="name of the skin, for the file"
        )


def add_recording_options(parser: argparse.ArgumentParser, nodes: str) -> None:
    """Add what is said beside a recording: `--params`, `--poses`, `--camera` and `--topic`.

    Parameters
    ----------
    parser : ArgumentParser
        Parser of the command.
    nodes : str
        The nodes whose parameters count, for the help text.
    """
    parser.add_argument(
        "--params", type=Path, metavar="FILE", help=f"ROS 2 parameter file ({nodes})"
    )
    parser.add_argument(
        "--poses", type=Path, metavar="FILE", help="TUM poses of the camera in base, seconds"
    )
    parser.add_argument(
        "--camera", type=Path, metavar="FILE", help="calibration, ROS camera_info YAML"
    )
    parser.add_argument(
        "--topic", metavar="NAME", help="topic of the event packets, for bags that have several"
    )
