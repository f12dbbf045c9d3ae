"""`roller view`: show a running graph or a result in the browser."""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from roller_core.command_help import add_examples
from roller_core.option_types import number

if TYPE_CHECKING:
    from roller_bringup.view.scene import Scene


def add_parser(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add `view` to the command's parser."""
    parser = subparsers.add_parser(
        "view",
        help="show a running graph or a result in the browser",
        description="Serve the operator's page: height map, findings, depth, text and the nodes' "
        "health. It runs beside the graph and never holds it up.",
    )
    parser.add_argument(
        "input",
        type=Path,
        nargs="?",
        metavar="INPUT",
        help="result folder or recording (the running graph)",
    )
    parser.add_argument("--host", default="127.0.0.1", help="address to listen at (127.0.0.1)")
    parser.add_argument(
        "--port", type=number(int, 0, 65535), default=8090, help="port; 0: any (8090)"
    )
    parser.add_argument(
        "--namespace", default="", metavar="NAME", help="of the cell, where a graph has several"
    )
    parser.add_argument("--rerun", action="store_true", help="hand it to rerun instead")
    add_examples(
        parser,
        "view  # the running graph, at http://127.0.0.1:8090/",
        "view output/demo  # what a demonstration, replay or inspection wrote",
        "view scan  # a recording: its results, or those of a replay of it",
        "view --host 0.0.0.0  # for other machines too; the address printed holds a token",
        "view output/demo --rerun  # hand it to rerun, where that is installed",
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Serve the page until Ctrl-C."""
    if args.rerun:
        from roller_bringup.view.rerun import hand_over

        return hand_over(args.input, args.namespace)
    from roller_bringup.view.http_server import check_address
    from roller_bringup.view.server import PageServer

    if args.input is None:
        from roller_bringup.view.graph import Graph
        from roller_bringup.view.scene import Scene
        from roller_core.memory import return_freed_memory

        return_freed_memory()
        scene = Scene("live")
        server = PageServer(scene, args.host, args.port)
        with Graph(scene, args.namespace):
            _serve(server)
        return 0
    check_address(args.host, args.port)  # a recording is replayed for minutes
    with tempfile.TemporaryDirectory(prefix="roller-view-") as aside:
        _serve(PageServer(_scene_of(args.input, Path(aside)), args.host, args.port))
    return 0


def _scene_of(source: Path, aside: Path) -> Scene:
    """A result folder as it is, a recording with the results that it holds or a replay gives."""
    from roller_bringup.view.recorded import results_of
    from roller_bringup.view.result import is_result, read_result

    return read_result(source if is_result(source) else results_of(source, aside), source.name)


def _serve(server: object) -> None:
    from roller_bringup.view.server import PageServer
    from roller_core.signals import Terminated

    assert isinstance(server, PageServer)
    print(f"open {server.url}  (Ctrl-C ends it)", flush=True)
    try:
        server.run()
    except KeyboardInterrupt as interrupt:
        if isinstance(interrupt, Terminated):
            raise
    print("ended", file=sys.stderr)
