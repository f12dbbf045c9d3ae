"""`roller demo`: roll the virtual cell over a plate, live."""

from __future__ import annotations

import argparse
import shlex
from pathlib import Path
from typing import TYPE_CHECKING

from roller_core.command_help import add_examples
from roller_core.option_types import add_output
from roller_inspect.commands.options import add_method_option
from roller_sim.presets import COATINGS

if TYPE_CHECKING:
    from roller_sim.relief import Region


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `demo` to the command's parser."""
    parser = subparsers.add_parser(
        "demo",
        help="roll the virtual cell over a plate, live",
        description="Roll the virtual cell over a part with Braille, relief and defects through "
        "the real graph (separate processes, DDS), record it, and compare with the known truth.",
    )
    add_output(parser, "results go here (output/demo)", default=Path("output/demo"))
    parser.add_argument("--scene", default="part", help="what to roll over (part)")
    parser.add_argument(
        "--coating", choices=tuple(COATINGS), default="textured",
        help="what is printed on the skin (textured)",
    )  # fmt: skip
    parser.add_argument("--speed", type=float, default=0.3, metavar="V", help="m/s (0.3)")
    add_method_option(parser, "focus")
    add_examples(
        parser,
        "demo",
        "demo --scene demo --coating plain --output output/objects",
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run the graph, gather its results, draw and print."""
    from roller_core.output_folder import OutputFolder
    from roller_sim.cell_settings import VirtualCellSettings
    from roller_sim.scenes import build_scene

    # Before anything is started, or an earlier result is touched.
    scan = {"scene": {"name": args.scene}, "motion": {"speed": args.speed}}
    scene = build_scene(VirtualCellSettings.create(scan, "demo").scene)
    face = next((region for region in scene.regions if region.name == "face"), None)
    with OutputFolder(args.output, "demo", always=["report.json"]) as output:
        lines = _run(args, output.partial, face)
    # When all is in place: whoever reads may go.
    print("\n".join(lines))
    print(f"look at it in the browser: ./roller view {shlex.quote(str(args.output))}")
    return 0


def _run(args: argparse.Namespace, folder: Path, face: Region | None) -> list[str]:
    """Roll, record, inspect and compare; returns what came of it, for people."""
    import yaml

    from roller_bringup.demo_inspection import inspect_part, write_recipe
    from roller_bringup.launching import load
    from roller_bringup.launching.locate import package_share
    from roller_bringup.live import check_no_duplicate_nodes, run_until_done
    from roller_inspect.results.recorded import gather
    from roller_inspect.results.run_report import Report
    from roller_inspect.results.summary import demo_table

    parameters = folder / "parameters.yaml"
    cell = {"truth_output": str(folder / "truth"), **COATINGS[args.coating]}
    nodes = {"/**/virtual_cell": cell, "/**/recorder": {"output": str(folder / "bag")}}
    parameters.write_text(
        yaml.safe_dump({node: {"ros__parameters": values} for node, values in nodes.items()})
    )
    calibration = package_share("roller_bringup") / "config" / "virtual_cell_ring.yaml"
    arguments = {
        "calibration": str(calibration),
        "scene": args.scene,
        "speed": str(args.speed),
        "method": args.method,
        "record": "true",
        "params": str(parameters),
    }
    recipe = folder / "recipe.yaml"
    if face is not None:
        write_recipe(face, recipe)
        arguments |= {"inspect": "true", "recipe": str(recipe)}
    launch_file = package_share("roller_bringup") / "launch" / "virtual.launch.xml"
    with load(launch_file, arguments) as plan:
        check_no_duplicate_nodes(plan)
        seen = run_until_done(plan, report=print)
    parameters.unlink()  # it names folders of this run
    arguments |= {"calibration": calibration.name} | ({"recipe": recipe.name} if face else {})
    report = Report(
        "virtual cell, live",
        args.method,
        {
            "launch": {k: v for k, v in arguments.items() if k != "params"},
            "virtual_cell": COATINGS[args.coating],
        },
        f"scene {args.scene} at {args.speed:g} m/s, {args.coating} coating, live",
    )
    report.totals["live"] = {name: values for name, (_, values) in seen.statuses.items()}
    for values in report.totals["live"].values():
        report.edge_drift = values.get("edge_drift", report.edge_drift)
    gather(folder / "bag", folder, folder / "truth", report)
    inspected: list[str] = []
    if face is not None:
        depth = report.totals["live"].get(
            "surface: points" if args.method == "surface" else "emvs: depth", {}
        )
        events = int(depth.get("events", 0))
        inspected = inspect_part(folder, recipe, calibration, report, events)
    from roller_inspect.results.overview import draw_overview

    draw_overview(folder, folder / "truth", folder / "bag")
    return [demo_table(report, folder, args.output), *inspected]
