"""`make soak`: the cell's whole graph for as long as asked, while faults are injected.

Emulated camera and robot repeat one simulated scan, with a quiet stretch after each. In a quiet
stretch everything that was sent has been taken or lost, so messages can be accounted for: what a
node sent since the last such moment must have been taken, or be counted as lost, left out or
foreign, by each node that was there all the time.
"""

import argparse
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from own import ros_domain
from roller_core.output_folder import OutputFolder

from .faults import OWN_SHM, Fault, Faults
from .graph import NODES, PAGE, Graph
from .table import table

SPEED_M_S = 0.1
#: One of so many simulated events: as much as a busy scan has, on a machine that does all of it.
ONE_OF = 3
#: Longest time until all work again after a fault is over, s.
RECOVERY_S = 120.0


def inject(graph: Graph, faults: Faults, what: str, fault: Fault) -> dict[str, Any]:
    """Inject a fault, wait until all works again; what came of it."""
    begin, faults.failed = time.monotonic(), ""
    row: dict[str, Any] = {"at_s": round(begin - graph.begin_s), "fault": what}
    reason = fault()
    if reason is not None:
        return row | {"outcome": "skipped", "recovery_s": None, "said": reason}
    over = time.monotonic()
    before = {n: v for n, v in graph.work().items() if graph.alive[n].begin_s < begin}
    # A node that is gone won't come back.
    graph.run(RECOVERY_S, lambda: bool(graph.gone()) or not graph.idle(before, over))
    gone = graph.gone()
    bad = gone or graph.idle(before, over)
    said = [faults.failed] if faults.failed else []
    said += [f"{n}: {graph.eyes.said(n)}" for n in bad]
    for name in bad:
        graph.end(name, signal.SIGKILL)
        graph.start(name)
    return row | {
        "outcome": "survived" if not said else "ended" if gone else "stuck",
        "recovery_s": round(time.monotonic() - over, 1),
        "said": "; ".join(said),
    }


def soak(graph: Graph, faults: Faults, args: argparse.Namespace) -> list[dict[str, Any]]:
    """Run the graph for as long as asked; what came of each fault.

    Raises
    ------
    RuntimeError
        If the graph doesn't work before the first.
    """
    end = time.monotonic() + args.minutes * 60
    graph.begin()
    graph.run(180.0, lambda: bool(graph.gone()) or not graph.idle({}))
    if bad := graph.gone() or graph.idle({}):
        raise RuntimeError("\n".join(f"{name} does not work\n{graph.log(name)}" for name in bad))
    graph.run(end - time.monotonic() if args.calm else 20.0)
    rows = []
    for what, fault in faults:
        if time.monotonic() > end:
            break
        if not re.search(args.only, what):
            continue
        rows.append(inject(graph, faults, what, fault))
        print(rows[-1], flush=True)
        graph.run(faults.random.uniform(0.0, graph.period_s))
    graph.run(2 * graph.period_s)
    return rows


def main() -> int:
    """Run it; 0 if all faults were survived and nothing was lost uncounted."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--calm", action="store_true", help="no faults: what an hour grows by")
    parser.add_argument("--only", default="", help="faults whose names this matches")
    parser.add_argument("--speed", type=float, default=SPEED_M_S, help="of rolling, m/s")
    parser.add_argument("--one-of", type=int, default=ONE_OF, help="sends one of so many events")
    parser.add_argument("--output", type=Path, default=Path("output/soak"))
    args = parser.parse_args()
    os.environ["ROLLER_TRACEBACK"] = "1"
    with ExitStack() as stack:
        output = stack.enter_context(OutputFolder(args.output, "soak"))
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="roller_soak_")))
        os.environ["ROS_DOMAIN_ID"] = str(stack.enter_context(ros_domain()))
        graph = Graph(folder, args.speed, args.one_of)
        stack.callback(graph.close)
        faults = Faults(graph, random.Random(args.seed))
        stack.callback(faults.close)
        begin = time.monotonic()
        rows = soak(graph, faults, args)
        page, data = table(graph, rows, time.monotonic() - begin, args.seed)
        (output.partial / "soak.md").write_text(page)
        (output.partial / "soak.json").write_text(json.dumps(data, indent=1) + "\n")
        for name in (*NODES, PAGE):
            shutil.copy(folder / f"{name}.log", output.partial)
        print(page)
        totals = data["totals"]
        bad = (
            totals["faults injected"] - totals["survived"]
            or totals["lost and not counted"]
            or graph.gone()
        )
    return 1 if bad else 0


def own_shared_memory() -> None:
    """Go on with a /dev/shm of one's own, where that may be had: filling it harms nobody."""
    if OWN_SHM in os.environ or not shutil.which("unshare"):
        return
    script = 'mount -t tmpfs -o size=1g tmpfs /dev/shm && exec env SOAK_OWN_SHM=1 "$@"'
    words = ["unshare", "--mount", "sh", "-c", script, "sh"]
    if subprocess.run([*words, "true"], capture_output=True).returncode == 0:
        os.execvp("unshare", [*words, sys.executable, "-m", "soak.soak", *sys.argv[1:]])


if __name__ == "__main__":
    own_shared_memory()
    sys.exit(main())
