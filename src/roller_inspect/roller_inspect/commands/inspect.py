"""`roller inspect`: replay a recording and say whether the part is good."""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from roller_core.command_help import add_examples
from roller_core.progress import progress_bar
from roller_inspect.exports import EXPORTS

from .options import add_processing_options, open_input, recipe_file

if TYPE_CHECKING:
    from roller_inspect.results.run_report import Report

#: Exit codes by verdict; 1 is a fault, 2 wrong usage.
EXIT_CODES = {"conform": 0, "nonconform": 3, "inconclusive": 4, "unmeasured": 4}
USAGE = 2


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `inspect` to the command's parser."""
    parser = subparsers.add_parser(
        "inspect",
        help="replay a recording and say whether the part is good",
        description="Process a recording as `roller replay` does and hold its surface against a "
        "reference, by a recipe. Exits with 0: conform, 3: not conform, 4: inconclusive or "
        "unmeasured; 1: a fault, 2: wrong usage.",
    )
    add_processing_options(parser, "surface", "emvs, stitcher, surface, braille, inspect")
    add_inspection_options(parser)
    parser.add_argument("--part-id", metavar="ID", help="number of the part (the input's name)")
    add_examples(
        parser,
        "inspect scan --output result",
        "inspect scan --output result --recipe bracket.yaml --part-id A-1207 --export x3p,sdf",
        "inspect teach good_1 good_2 good_3 --output golden  # from good parts, a reference",
        "inspect scan --output result --reference golden:golden  # what differs from them",
    )
    parser.set_defaults(run=run)
    from .teach import add_parser as add_teach_parser

    add_teach_parser(subparsers)


def rewritten(words: list[str]) -> list[str]:
    """`inspect teach ...` as one word, which a scan called `teach` could be."""
    return ["inspect-teach", *words[2:]] if words[:2] == ["inspect", "teach"] else words


def add_inspection_options(parser: argparse.ArgumentParser) -> None:
    """Add what is said of an inspection: `--recipe`, `--reference` and `--export`."""
    parser.add_argument(
        "--recipe",
        type=Path,
        metavar="FILE",
        help="recipe, YAML (that of --params, or the default)",
    )
    parser.add_argument(
        "--reference",
        metavar="R",
        help="before the recipe's: self, nominal, nominal:FORM, golden:DIR or cad:FILE (STL, STEP)",
    )
    parser.add_argument(
        "--export",
        type=_exports,
        default=(),
        metavar="LIST",
        help=f"of {','.join(EXPORTS)}, with commas",
    )


def main() -> int:
    """Run the command by itself, as the jobs of a batch do."""
    from roller_core.errors import RollerError

    parser = argparse.ArgumentParser(prog="roller")
    add_parser(parser.add_subparsers())
    args = parser.parse_args()
    try:
        return int(args.run(args))
    except RollerError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1


def _exports(text: str) -> tuple[str, ...]:
    names = tuple(name for name in text.replace(" ", "").split(",") if name)
    for name in names:
        if name not in EXPORTS:
            raise argparse.ArgumentTypeError(f"'{name}' is not one of {', '.join(EXPORTS)}")
    return names


def run(args: argparse.Namespace) -> int:
    """Replay, inspect, and say the verdict."""
    from roller_core.output_folder import OutputFolder
    from roller_inspect.inspect_stage import InspectStage, inspect_parameters
    from roller_inspect.pipeline import PipelineSettings
    from roller_inspect.recipe import RecipeError, load_recipe
    from roller_inspect.references import ReferenceError
    from roller_inspect.results.summary import inspection_summary, summary

    args.recipe = recipe_file(args.recipe, args.params)
    try:
        recipe = load_recipe(args.recipe, args.reference)
        settings = PipelineSettings.load(args.params, args.method)
        frame = settings.surface.base_frame if settings.sweeps else settings.stitcher.base_frame
        name = args.part_id or args.input.resolve().name
        part = name.encode(errors="backslashreplace").decode()
        stage = InspectStage(inspect_parameters(args.params, part=part, base_frame=frame), recipe)
    except (RecipeError, ReferenceError) as error:
        print(f"error: {error}", file=sys.stderr)
        return USAGE
    reference = Path(recipe.reference.path) if recipe.reference.path else None
    inputs = (args.input, args.params, args.poses, args.camera, args.recipe, reference)
    # Marked as a replay's: one that comes later must not leave this verdict beside its surface.
    with OutputFolder(args.output, "replay", inputs, always=["report.json"]) as output:
        recording = open_input(args, settings)
        report, document, faults = _inspect(args, settings, stage, recording, output.partial)
    # When all is in place: whoever reads may go.
    print(summary(report, args.output))
    print(inspection_summary(document))
    for line in faults:
        print(f"error: {line}", file=sys.stderr)
    verdict = document["verdict"]
    if verdict in ("inconclusive", "unmeasured"):
        print(f"{verdict}: {document['reason']}", file=sys.stderr)
    return 1 if faults else EXIT_CODES[verdict]


def _inspect(
    args: argparse.Namespace, settings: Any, stage: Any, recording: Any, folder: Path
) -> tuple[Report, dict[str, Any], list[str]]:
    """Write replay and inspection; returns their reports, and what was wrong."""
    from roller_inspect.inspect_stage import Inspected
    from roller_inspect.judgement import longest_part, with_faults
    from roller_inspect.replay import replay
    from roller_inspect.report.document import Scan, inspection_document
    from roller_inspect.results.inspection_files import write_inspection

    parts: list[Inspected] = []

    def take(result: Any) -> None:
        if isinstance(result.found, Inspected):
            parts.append(result.found)

    with progress_bar(f"inspect {args.input.name}") as progress:
        report = replay(
            recording, settings, folder, args.input, not args.no_braille, progress, stage, take
        )
    if not args.no_picture:
        from roller_inspect.results.overview import draw_overview

        draw_overview(folder, args.input)
    faults = list(report.faults)
    if len(parts) > 1:
        each = ", ".join(f"{found.part} {found.judgement.verdict}" for found in parts)
        faults.append(
            f"{args.input}: {len(parts)} parts, as its source started again, or the scan came back "
            f"to the same place after {stage.settings.idle_flush_s:g} s (inspect: idle_flush_s): "
            f"{each}; the files are of the longest"
        )
    inspected = longest_part(parts, stage.recipe, stage.settings.part)
    packets, lost = report.totals["packets"], report.totals["lost_packets"]
    share = lost / max(packets + lost, 1)
    inspected = replace(inspected, judgement=with_faults(inspected.judgement, faults, share))
    scan = Scan(
        args.input, args.params, recording.camera, args.method, report.settings,
        report.totals["events"], report.totals["lost_packets"], faults,
    )  # fmt: skip
    document = inspection_document(inspected, stage.recipe, scan)
    write_inspection(folder, document, inspected.found, stage.recipe.depth_tolerance_m, args.export)
    return report, document, faults
