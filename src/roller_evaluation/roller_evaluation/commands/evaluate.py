"""`roller evaluate`: repeat the paper's experiments on the virtual cell."""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from roller_core.command_help import add_examples
from roller_core.errors import SettingsError
from roller_core.option_types import add_output, number
from roller_core.output_folder import OutputFolder
from roller_evaluation.commands import check_names, given, numbers, shown_progress, words
from roller_evaluation.experiments import EXPERIMENTS, EvaluationOptions
from roller_evaluation.tables import Table, show_tables
from roller_sim.presets import COATINGS, LIGHTS


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `evaluate` to the command's parser, with its subcommands."""
    parser = subparsers.add_parser(
        "evaluate",
        help="repeat the paper's experiments on the virtual cell",
        description="Repeat the paper's experiments on the virtual cell and set the results "
        "beside the paper's: a page, index.html, and the same as JSON. A run that was broken off "
        "goes on where it was.",
        epilog="Experiments: " + "; ".join(f"{k}: {v}" for k, v in EXPERIMENTS.items()) + ".",
    )
    add_output(parser, "results go here (default: evaluation)", default=Path("evaluation"))
    parser.add_argument("--quick", action="store_true", help="one pass of each kind, few objects")
    parser.add_argument("--only", type=words, metavar="A,B", help="experiments, of those below")
    parser.add_argument(
        "--repeats", type=number(int, 1, 100_000), metavar="N", help="passes of each kind (5)"
    )
    _add_seed(parser)
    parser.add_argument("--lights", type=words, metavar="A,B", help="of ring, dome, strong (all)")
    parser.add_argument(
        "--conditions", type=words, metavar="A,B", help="Braille: light and sensor (all)"
    )
    parser.add_argument(
        "--params", type=words, metavar="FILE,LIGHT=FILE",
        help="edge drift of focus and surface by light, without one the ring's, such as "
        "config/virtual_cell_ring.yaml,strong=config/virtual_cell_strong.yaml (none: not "
        "corrected)",
    )  # fmt: skip
    parser.add_argument(
        "--results", type=Path, metavar="FILE",
        help="also write a page (Markdown) of objects, sensors, map, time and braille, with its "
        "picture; what people wrote below the page's end line is kept",
    )  # fmt: skip
    _add_jobs(parser)
    add_examples(
        parser,
        "evaluate --quick --output output/evaluation  # minutes",
        "evaluate --only objects --params config/virtual_cell_ring.yaml",
        "evaluate --only braille --repeats 2",
        "evaluate braille --speeds 0.1,0.3",
    )
    parser.set_defaults(run=_run_all)
    experiments = parser.add_subparsers(dest="experiment", metavar="braille, coating, pod")
    _add_braille(experiments)
    _add_coating(experiments)
    _add_pod(experiments)


def _add_seed(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--seed", type=number(int, 0, 2**31 - 1), help="seed of all chance (1)")


def _add_jobs(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--jobs",
        type=number(int, 1, 1000),
        default=os.cpu_count() or 1,
        metavar="N",
        help="processes (all cores)",
    )


def _run_all(args: argparse.Namespace) -> int:
    from roller_evaluation.braille import CONDITIONS
    from roller_evaluation.evaluation import run_evaluation
    from roller_evaluation.results_page import check_results, write_results

    chosen = given(args, "only", "repeats", "seed", "lights", "conditions")
    check_names("only", chosen.get("only", ()), EXPERIMENTS)
    check_names("lights", chosen.get("lights", ()), LIGHTS)
    check_names("conditions", chosen.get("conditions", ()), CONDITIONS)
    words = _command_line(args, chosen)
    chosen["calibrated"] = _drift(args.params)
    options = EvaluationOptions.short(**chosen) if args.quick else EvaluationOptions(**chosen)
    if args.results is not None:
        check_results(args.results)
    with (
        OutputFolder(args.output, "evaluate", lasting=["passes"], always=["rows.csv"]) as output,
        shown_progress("evaluate") as on_progress,
    ):
        result = run_evaluation(options, output.partial, jobs=args.jobs, on_progress=on_progress)
    names = [args.output / name for name in ("index.html", "evaluation.json", "rows.csv")]
    if args.results is not None:
        write_results(result, options, words, args.results)
        names.append(args.results)
    show_tables([table for tables in result["tables"].values() for table in tables])
    print("files: " + ", ".join(map(str, names)))
    return 0


def _drift(params: tuple[str, ...] | None) -> dict[str, Any]:
    """Edge drift by light of the depth methods that correct it, from parameter files."""
    from roller_core.parameter_files import read_parameters

    nodes = {"focus": "emvs", "surface": "surface"}
    out: dict[str, Any] = {}
    for word in params or ():
        light, _, file = word.rpartition("=")
        light = light or "ring"
        check_names("params", (light,), LIGHTS)
        found = {
            m: read_parameters(Path(file), node).get("edge_drift") for m, node in nodes.items()
        }
        if not all(found.values()):
            raise SettingsError(f"--params {file}: no edge_drift in it; see `roller calibrate`")
        out[light] = {method: {"edge_drift": drift} for method, drift in found.items()}
    return out


def _command_line(args: argparse.Namespace, chosen: dict[str, Any]) -> list[str]:
    """What makes the same figures again."""
    out = ["roller", "evaluate", "--results", str(args.results)]
    out += ["--quick"] if args.quick else []
    out += ["--params", ",".join(args.params)] if args.params is not None else []
    for name, value in chosen.items():
        out += [f"--{name}", ",".join(value) if isinstance(value, tuple) else str(value)]
    return out


def _add_experiment(
    experiments: argparse._SubParsersAction[argparse.ArgumentParser],
    name: str,
    summary: str,
    description: str,
    quick: str,
    run: Callable[[argparse.Namespace], int],
) -> argparse.ArgumentParser:
    parser = experiments.add_parser(name, help=summary, description=description)
    own = f"evaluation_{name}"
    add_output(parser, f"results go here (default: {own})", default=Path(own))
    parser.add_argument("--quick", action="store_true", help=quick)
    parser.add_argument("--speeds", type=numbers, metavar="V,W", help="m/s")
    _add_jobs(parser)
    parser.set_defaults(run=run)
    return parser


def _measured(
    args: argparse.Namespace,
    chosen: dict[str, Any],
    options: Any,
    measure: Callable[..., dict[str, Any]],
    tables: Callable[[dict[str, Any]], Sequence[Table]],
) -> dict[str, Any]:
    """Result of one experiment, shown as tables."""
    speeds = chosen.get("speeds", (0.3,))
    if not speeds or any(not 0.01 <= v <= 2.0 for v in speeds):
        raise SettingsError("--speeds: 0.01 to 2 m/s, such as 0.1,0.3")
    wanted = options.short(**chosen) if args.quick else options(**chosen)
    name = f"evaluate {args.experiment}"
    with (
        OutputFolder(args.output, name, lasting=["passes"], always=["rows.csv"]) as output,
        shown_progress("evaluate") as on_progress,
    ):
        result = measure(wanted, output.partial, jobs=args.jobs, on_progress=on_progress)
    show_tables(tables(result))
    return result


def _add_braille(experiments: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    parser = _add_experiment(
        experiments, "braille", "error rates of reading Braille",
        "Character and word error rates of reading Braille by speed, noise and method, and with a "
        "wrong speed or depth.",
        "a few letters at one speed", _run_braille,
    )  # fmt: skip
    parser.add_argument("--text", help="text of the plate: a–z, digits, spaces; \\n ends a line")
    _add_seed(parser)


def _run_braille(args: argparse.Namespace) -> int:
    from roller_evaluation.braille import BrailleOptions, run_braille
    from roller_evaluation.braille_report import tables

    chosen = given(args, "speeds", "seed")
    if args.text is not None:
        chosen["text"] = args.text.replace("\\n", "\n")
    _measured(args, chosen, BrailleOptions, run_braille, tables)
    print(f"files: {args.output}/braille.json, {args.output}/braille.png")
    return 0


def _add_coating(experiments: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    parser = _add_experiment(
        experiments, "coating", "which skin to print",
        "Error, measured area and rate of events by contrast and grain of the skin's coating, by "
        "speed and by the sensor's threshold.",
        "two contrasts, few rows", _run_coating,
    )  # fmt: skip
    _add_seed(parser)


def _run_coating(args: argparse.Namespace) -> int:
    from roller_evaluation.coating import CoatingOptions, run_coating, tables, verdict

    result = _measured(args, given(args, "speeds", "seed"), CoatingOptions, run_coating, tables)
    print(verdict(result["recommended"]))
    print(f"files: {args.output}/coating.json, {args.output}/coating.png, {args.output}/rows.csv")
    return 0


def _add_pod(experiments: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    parser = _add_experiment(
        experiments, "pod", "probability of detection of defects",
        "Inspect plates with labelled defects: probability of detection by depth, kind, speed and "
        "coating, errors of sizes, false calls.",
        "a few defects, few rows", _run_pod,
    )  # fmt: skip
    parser.add_argument(
        "--plates",
        type=number(int, 1, 100_000),
        metavar="N",
        help="with defects, of each kind (10)",
    )
    parser.add_argument("--coatings", type=words, metavar="A,B", help="textured, plain (both)")
    parser.add_argument("--kinds", type=words, metavar="A,B", help="of defects (all)")
    parser.add_argument("--depths-mm", type=numbers, metavar="D,E", help="0.03 to 0.4")
    parser.add_argument("--widths-mm", type=numbers, metavar="W,X", help="1,2,3")
    parser.add_argument(
        "--tuning", action="store_true", help="the plates that the inspection may be tuned on"
    )


def _run_pod(args: argparse.Namespace) -> int:
    from roller_evaluation.pod import TUNING_SEED, PodOptions, run_pod, tables
    from roller_inspect.findings import KINDS

    chosen = given(args, "plates", "speeds", "coatings", "kinds", "depths_mm", "widths_mm")
    check_names("coatings", chosen.get("coatings", ()), COATINGS)
    check_names("kinds", chosen.get("kinds", ()), KINDS)
    if args.tuning:
        chosen["seed"] = TUNING_SEED
    _measured(args, chosen, PodOptions, run_pod, tables)
    print(f"files: {args.output}/pod.json, {args.output}/pod.png, {args.output}/rows.csv")
    return 0
