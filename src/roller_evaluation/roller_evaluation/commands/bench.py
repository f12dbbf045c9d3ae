"""`roller bench`: measure speed against error."""

from __future__ import annotations

import argparse

from roller_core.command_help import add_examples
from roller_core.errors import SettingsError
from roller_core.option_types import add_output, number
from roller_core.output_folder import OutputFolder
from roller_emvs.depth_settings import REPLAY_METHODS
from roller_evaluation.commands import check_names, given, numbers, shown_progress, words

#: What a whole run alone writes.
_PICTURE = "growth.png"


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `bench` to the command's parser."""
    parser = subparsers.add_parser(
        "bench",
        help="measure speed against error",
        description="Measure what each depth method and setting costs and how far its depths are "
        "from the known truth of simulated scans.",
    )
    add_output(parser, "results go here", required=True)
    parser.add_argument(
        "--quick", action="store_true", help="two objects, one repeat, few variations"
    )
    parser.add_argument(
        "--repeats", type=number(int, 1, 100_000), metavar="N", help="times each case is timed"
    )
    parser.add_argument(
        "--objects", type=words, metavar="A,B", help="objects of the virtual cell (default: all)"
    )
    parser.add_argument(
        "--speeds",
        type=numbers,
        metavar="V,W",
        help="m/s; the first is that of all variations (default: 0.3,0.5); the fixed case and how "
        "the work grows are at 0.5 whatever is given",
    )
    parser.add_argument(
        "--methods", type=words, metavar="A,B",
        help=f"of {', '.join(REPLAY_METHODS)}; the fixed case and how the work grows are of focus "
        "and bma whatever is given",
    )  # fmt: skip
    add_examples(
        parser,
        "bench --output output/bench --quick  # minutes",
        "bench --output output/bench --methods focus,surface --speeds 0.3",
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Measure, write and print."""
    from roller_evaluation.bench import INCOMPLETE, Measured, measure, write_bench
    from roller_evaluation.bench_plan import ALL_OBJECTS, BenchOptions
    from roller_evaluation.bench_tables import tables
    from roller_evaluation.tables import show_tables

    chosen = given(args, "repeats", "objects", "speeds", "methods")
    check_names("objects", chosen.get("objects", ()), ALL_OBJECTS)
    check_names("methods", chosen.get("methods", ()), REPLAY_METHODS)
    if any(not 0.001 <= v <= 2.0 for v in chosen.get("speeds", ())):
        raise SettingsError("--speeds: 0.001 to 2 m/s")
    options = BenchOptions.short(**chosen) if args.quick else BenchOptions(**chosen)
    measured = Measured()
    interrupt: KeyboardInterrupt | None = None
    with OutputFolder(args.output, "bench", lasting=["scans"], always=["rows.csv"]) as output:
        try:
            with shown_progress("bench") as on_progress:
                measure(options, output.partial / "scans", measured, on_progress)
        except KeyboardInterrupt as error:
            if not measured.depth:
                raise
            interrupt = error
        result = write_bench(options, measured, output.partial)
        written = sorted(path.name for path in output.partial.iterdir() if path.is_file())
        if interrupt is not None and (output.path / _PICTURE).exists():
            show_tables(tables(result))
            print(f"{INCOMPLETE} The whole result of an earlier run stays in {args.output}.")
            raise interrupt
    # When all is in place: whoever reads may go.
    show_tables(tables(result))
    print("files: " + ", ".join(f"{args.output}/{name}" for name in written))
    if interrupt is not None:
        print(INCOMPLETE)
        raise interrupt
    return 0
