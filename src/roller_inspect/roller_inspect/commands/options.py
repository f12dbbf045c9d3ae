"""Options that several commands have in common."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from roller_core.option_types import Once, add_output, path
from roller_emvs.depth_settings import REPLAY_METHODS

if TYPE_CHECKING:
    from roller_inspect.pipeline import PipelineSettings
    from roller_recording.reading import Recording


def add_processing_options(
    parser: argparse.ArgumentParser,
    method: str | None = None,
    nodes: str = "emvs, stitcher, surface, braille",
) -> None:
    """Add what is said of one recording that is processed: INPUT, `--output` and the method.

    Parameters
    ----------
    parser : ArgumentParser
        Parser of the command.
    method : str, optional
        The depth method by default; without it that of the parameter file, or focus.
    nodes : str
        The nodes whose parameters count, for the help text.
    """
    parser.add_argument("input", type=path, metavar="INPUT", help="recording")
    add_output(parser, "results go here", required=True)
    add_method_option(parser, method)
    add_recording_options(parser, nodes)
    parser.add_argument("--no-braille", action="store_true", help="don't look for Braille")
    parser.add_argument("--no-picture", action="store_true", help="don't draw overview.png")


def add_method_option(
    parser: argparse.ArgumentParser, default: str | None, otherwise: str = "focus"
) -> None:
    """Add `--method`, one of those of a replay; `otherwise`: what holds where it isn't given."""
    shown = default or f"default: {otherwise}"
    parser.add_argument(
        "--method", choices=REPLAY_METHODS, default=default, help=f"depth method ({shown})"
    )


def open_input(args: argparse.Namespace, settings: PipelineSettings) -> Recording:
    """The recording that those options name.

    Raises
    ------
    RollerError
        If it can't be read, or the parameters are for another camera.
    """
    from roller_core.calibration_file import check_same_camera
    from roller_recording.reading import open_recording

    gap_s = settings.max_pose_gap_s
    recording = open_recording(args.input, args.poses, args.camera, gap_s, args.topic)
    check_same_camera(args.params, recording.camera)
    return recording


def recipe_file(recipe: Path | None, params: Path | None) -> Path | None:
    """The recipe that counts: `--recipe`, or else what `--params` names for node `inspect`."""
    from roller_inspect.inspect_stage import inspect_parameters

    if recipe is not None:
        return recipe
    named = inspect_parameters(params).recipe
    return Path(named).expanduser() if named else None


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
        "--params", action=Once, type=Path, metavar="FILE", help=f"ROS 2 parameter file ({nodes})"
    )
    parser.add_argument(
        "--poses", type=Path, metavar="FILE", help="TUM poses of the camera in base, seconds"
    )
    add_camera_options(parser)


def add_camera_options(parser: argparse.ArgumentParser) -> None:
    """Add what is said of the camera beside a recording: `--camera` and `--topic`."""
    parser.add_argument(
        "--camera", type=Path, metavar="FILE", help="calibration, ROS camera_info YAML"
    )
    parser.add_argument(
        "--topic", metavar="NAME", help="topic of the event packets, for bags that have several"
    )
