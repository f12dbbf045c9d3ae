"""The node of the inspection."""

import subprocess
import sys

import pytest

pytest.importorskip("rclpy")

from roller_inspect import inspect_node


def test_on_busy_cores_inspection_comes_last(monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[int] = []
    monkeypatch.setattr(inspect_node, "give_way", given.append)
    monkeypatch.setattr(inspect_node, "run_node", lambda make: 0)
    with pytest.raises(SystemExit):
        inspect_node.main()
    assert [step > 0 for step in given] == [True]


def test_what_finding_takes_is_loaded_before_the_scan() -> None:
    code = (
        "from roller_inspect.height_map import _multigrid\n"
        "from roller_inspect.inspect_stage import InspectParameters, InspectStage\n"
        "stage = InspectStage(InspectParameters.create({}))\n"
        "stage.warm_up()\n"
        "assert _multigrid._cycle.signatures\n"
        "assert stage.counts()['points'] == 0 and not list(stage.results(flush=True))\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)
