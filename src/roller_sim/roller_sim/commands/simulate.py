"""`roller simulate`: a scan of the virtual cell, written as a bag with its truth."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import yaml
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from roller_core.bag_writer import BagFullError
from roller_core.command_help import add_examples
from roller_core.errors import SettingsError
from roller_core.option_types import Once, add_output
from roller_core.output_folder import OutputFolder
from roller_core.parameter_files import read_parameters
from roller_sim.bag import write_bag
from roller_sim.cell import VirtualCell
from roller_sim.cell_settings import VirtualCellSettings
from roller_sim.presets import COATINGS, LIGHTS
from roller_sim.scenes import SCENES

NODE = "virtual_cell"


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the subcommand `simulate`."""
    parser = subparsers.add_parser(
        "simulate",
        help="simulate a scan, written as a bag",
        description="Roll the virtual cell over a plate and write a rosbag2 with its truth.",
    )
    scene = parser.add_argument("scene", help=f"{', '.join(SCENES)} or mesh:FILE.stl")
    scene.completer = lambda **_: SCENES  # type: ignore[attr-defined]
    add_output(parser, "bag folder to make", required=True)
    parser.add_argument("--speed", type=float, metavar="V", help="speed of the scan, m/s (0.3)")
    parser.add_argument("--text", help="text of Braille and letter plates")
    parser.add_argument(
        "--length",
        type=float,
        metavar="MM",
        help="least length of the plate, mm; all of it is rolled over",
    )
    parser.add_argument("--press", type=float, metavar="MM", help="press depth at full contact, mm")
    parser.add_argument(
        "--contact", choices=["light", "medium", "full"], help="how hard it presses"
    )
    parser.add_argument("--light", choices=LIGHTS, help="light and sensor (ring)")
    parser.add_argument("--coating", choices=COATINGS, help="what is printed on the skin (plain)")
    parser.add_argument(
        "--threshold", type=float, metavar="C", help="contrast threshold of the sensor"
    )
    parser.add_argument(
        "--rate-cap", type=float, metavar="MEV", help="most events read out, 10^6/s"
    )
    parser.add_argument(
        "--encoding", metavar="NAME", help="mono, libcaer, libcaer_cmp (the default) or evt3"
    )
    parser.add_argument("--seed", type=int, metavar="N", help="seed of all chance (1)")
    parser.add_argument(
        "--params",
        action=Once,
        type=Path,
        metavar="FILE",
        help="parameter file of node virtual_cell",
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="GROUP.NAME=VALUE",
        help="any other setting of config/virtual_cell.yaml, e.g. "
        "scene.dot_height_mm=0.5 or light.speckle=0",
    )
    add_examples(
        parser,
        "simulate stairs --speed 0.3 --output scan",
        'simulate braille --text "hello" --output hello',
        "simulate stairs --set motion.reverse=true --output to_and_fro",
    )
    parser.set_defaults(run=run)


def settings_from(args: argparse.Namespace) -> VirtualCellSettings:
    """Settings: defaults, then the parameter file, then the options.

    Raises
    ------
    SettingsError
        If an entry is unknown, of the wrong type or out of range.
    """
    if args.text is not None and not args.text.strip():
        raise SettingsError("--text: is empty; leave it out for the scene's own")
    known = VirtualCellSettings.model_fields
    values = {k: v for k, v in read_parameters(args.params, NODE).items() if k in known}
    for preset in (LIGHTS.get(args.light, {}), COATINGS.get(args.coating, {})):
        for group, entries in preset.items():
            for name, value in entries.items():
                _put(values, f"{group}.{name}", value)
    options = {
        "scene.name": args.scene,
        "scene.text": args.text,
        "scene.length_mm": args.length,
        "skin.press_mm": args.press,
        "skin.contact": args.contact,
        "motion.speed": args.speed,
        "sensor.threshold": args.threshold,
        "sensor.rate_cap_mev_s": args.rate_cap,
        "packets.encoding": args.encoding,
        "seed": args.seed,
    }
    for name, value in options.items():
        if value is not None:
            _put(values, name, value)
    for entry in args.set:
        name, sign, text = entry.partition("=")
        if not sign:
            raise SettingsError(f"--set {entry}: expected GROUP.NAME=VALUE")
        try:
            value = yaml.safe_load(text)
        except (yaml.YAMLError, RecursionError, ValueError) as error:
            raise SettingsError(f"--set {entry[:80]}: the value can't be read as YAML") from error
        _put(values, name, value)
    return VirtualCellSettings.create(values, "simulate")


def _put(values: dict[str, Any], name: str, value: Any) -> None:
    *groups, last = name.split(".")
    for group in groups:
        values = values.setdefault(group, {})
        if not isinstance(values, dict):
            raise SettingsError(f"unknown entry '{name}'")
    values[last] = value


def run(args: argparse.Namespace) -> int:
    """Run the subcommand."""
    console = Console(stderr=True)
    settings = settings_from(args)
    columns = (
        TextColumn("simulating {task.fields[scene]}"),
        BarColumn(),
        TextColumn("{task.percentage:>3.0f}%"),
        TimeRemainingColumn(),
    )
    with (
        OutputFolder(args.output, "simulate", [args.params], new=True) as output,
        Progress(*columns, console=console, disable=not console.is_terminal) as bar,
    ):
        cell = VirtualCell(settings)
        task = bar.add_task("", total=1.0, scene=settings.scene.name)
        try:
            summary = write_bag(
                cell, output.partial, lambda share: bar.update(task, completed=share)
            )
        except BagFullError:
            output.publish()  # what is there is whole
            raise
    speed = cell.settings.motion.speed
    print(
        f"{args.output}: {summary.events} events in {summary.packets} packets, "
        f"{summary.poses} poses, {summary.images} images; {cell.travel_px:.0f} px of travel at "
        f"{speed:g} m/s, {summary.events / max(cell.travel_px, 1):.0f} events a pixel of travel"
    )
    if summary.dropped:
        print(f"{summary.dropped} events were cut by the rate cap")
    return 0
