"""`roller batch`: inspect many recordings."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from roller_core.command_help import add_examples
from roller_core.option_types import Once, add_output, number

from .inspect import USAGE, add_inspection_options
from .options import add_camera_options, add_method_option, recipe_file

if TYPE_CHECKING:
    from roller_inspect.batch.jobs import Job, Row
    from roller_inspect.recipe import Recipe

#: With less a job may hang: with 200 and 500 libraries did, where a thread couldn't be started.
_LEAST_MEMORY_MB = 1000


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `batch` to the command's parser."""
    parser = subparsers.add_parser(
        "batch",
        help="inspect many recordings",
        description="Inspect every recording in some folders, each in a process of its own. One "
        "that fails is a row of the summary; exits with 1 if any did.",
    )
    parser.add_argument("folders", type=Path, nargs="+", metavar="FOLDER", help="recordings")
    add_output(parser, "results go here", required=True)
    add_method_option(parser, "surface")
    parser.add_argument(
        "--params", action=Once, type=Path, metavar="FILE", help="ROS 2 parameter file"
    )
    add_camera_options(parser)
    add_inspection_options(parser)
    parser.add_argument(
        "--jobs", type=number(int, 1, 1000), default=1, metavar="N", help="at once (1)"
    )
    parser.add_argument(
        "--scheduler", metavar="tcp://HOST:PORT", help="Dask scheduler whose workers do the jobs"
    )
    parser.add_argument(
        "--resume", action="store_true", help="keep results that an earlier run has made"
    )
    parser.add_argument(
        "--timeout-s",
        type=number(float, 0, 1_000_000),
        default=0.0,
        metavar="S",
        help="most time of a job (no limit)",
    )
    parser.add_argument(
        "--memory-mb",
        type=_memory_mb,
        default=0,
        metavar="MB",
        help=f"most memory of a job, {_LEAST_MEMORY_MB} or more (no limit)",
    )
    add_examples(
        parser,
        "batch recordings --output results --jobs 4 --resume",
        "batch monday tuesday --output results --recipe bracket.yaml --timeout-s 600",
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run all jobs and write the summary."""
    from roller_core.output_folder import OutputFolder
    from roller_core.progress import progress_bar
    from roller_inspect.batch.jobs import find_recordings
    from roller_inspect.batch.summary import write_summary
    from roller_inspect.recipe import RecipeError, load_recipe

    args.recipe = recipe_file(args.recipe, args.params)
    try:
        recipe = load_recipe(args.recipe, args.reference)
    except RecipeError as error:
        print(f"error: {error}", file=sys.stderr)
        return USAGE
    for folder in args.folders:
        if not folder.is_dir():
            there = "a file; name the folder that holds it" if folder.exists() else "not there"
            print(f"error: {folder}: is {there}", file=sys.stderr)
            return USAGE
    unread: list[OSError] = []
    found = {f: list(find_recordings([f], unread.append)) for f in args.folders}
    for fault in unread:
        print(f"warning: {fault.filename}: can't be read ({fault.strerror})", file=sys.stderr)
    sources = list(dict.fromkeys(source for each in found.values() for source in each))
    if not sources:
        named = ", ".join(map(str, args.folders))
        print(f"error: {named}: no recordings there", file=sys.stderr)
        return USAGE
    for folder in (folder for folder, each in found.items() if not each):
        print(f"warning: {folder}: no recordings there", file=sys.stderr)
    jobs = _jobs(args, sources, recipe)
    reference = Path(recipe.reference.path) if recipe.reference.path else None
    inputs = [*args.folders, args.params, args.camera, args.recipe, reference]
    lasting = [job.key for job in jobs]
    with OutputFolder(
        args.output, "batch", inputs, lasting=lasting, always=["index.html"]
    ) as output:
        rows: list[Row] = []
        with progress_bar(f"inspect {len(jobs)} recordings") as progress:
            for row in _run_all(jobs, args):
                rows.append(row)
                said = row.error or row.reason
                print(f"{row.source}: {row.verdict or 'failed'}: {said}", flush=True)
                progress(len(rows) / len(jobs))
        rows.sort(key=lambda row: lasting.index(row.key))
        write_summary(output.partial, rows, output.path)
    failed = [row for row in rows if row.error]
    print(f"results in {args.output}/: index.html, summary.csv, summary.json")
    for row in failed:
        print(f"error: {row.source}: {row.error}", file=sys.stderr)
    return 1 if failed else 0


def _memory_mb(text: str) -> int:
    """Most memory of a job; 0: no limit."""
    return 0 if text == "0" else number(int, _LEAST_MEMORY_MB, 1_000_000)(text)


def _jobs(args: argparse.Namespace, sources: list[Path], recipe: Recipe) -> list[Job]:
    from roller_core.calibration_file import digest
    from roller_core.digests import data_digest
    from roller_core.errors import RollerError
    from roller_inspect.batch.jobs import Job, poses_beside
    from roller_inspect.batch.summary import read_rows
    from roller_inspect.report.document import software

    options = ["--method", args.method, "--no-picture"]
    for name in ("params", "camera", "topic", "recipe", "reference"):
        if (value := getattr(args, name)) is not None:
            # References are found from where the batch was started.
            options += [f"--{name}", str(value.resolve() if isinstance(value, Path) else value)]
    if args.export:
        options += ["--export", ",".join(args.export)]
    named = (args.params, args.camera, recipe.reference.path)
    read = [recipe.sha256(), *(digest(Path(path)) if path else "" for path in named), args.topic]
    earlier = read_rows(args.output) if args.resume else {}
    jobs: dict[str, Job] = {}
    for source in sources:
        poses = poses_beside(source)
        own = [] if poses is None else ["--poses", str(poses.resolve())]
        try:
            data = digest(source)
        except RollerError:
            data = str(source.resolve())  # the job says what is wrong
        found = [data, *read, args.method, args.export, software()]
        found += [digest(poses)] if poses is not None else []
        key = data_digest(found)[:16]
        if key in jobs:
            print(f"{source}: the same recording as {jobs[key].source}; inspected once")
            continue
        before = earlier.get(key)
        if before is not None and not before.verdict:
            print(f"{before.source}: tried again, it failed before: {before.error}")
        jobs[key] = Job(
            key, str(source.resolve()), str(args.output.resolve() / key), (*options, *own),
            args.resume, args.timeout_s, args.memory_mb * 1_000_000,
            before.seconds if before is not None and before.verdict else None,
        )  # fmt: skip
    return list(jobs.values())


def _run_all(jobs: list[Job], args: argparse.Namespace) -> Iterator[Row]:
    """Rows as they come."""
    from joblib import Parallel, delayed

    from roller_inspect.batch.jobs import run_job

    if args.scheduler is None:
        # A job is a process already; threads wait for them.
        work = Parallel(n_jobs=args.jobs, backend="threading", return_as="generator")
        yield from work(delayed(run_job)(job) for job in jobs)
    else:
        from roller_inspect.batch.dask_workers import rows_of_workers

        yield from rows_of_workers(jobs, args.scheduler)
