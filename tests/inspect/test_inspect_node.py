"""The node of the inspection."""

import pytest

pytest.importorskip("rclpy")

from roller_inspect import inspect_node


def test_on_busy_cores_inspection_comes_last(monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[int] = []
    monkeypatch.setattr(inspect_node.os, "nice", given.append)
    monkeypatch.setattr(inspect_node, "run_node", lambda make: 0)
    with pytest.raises(SystemExit):
        inspect_node.main()
    assert [step > 0 for step in given] == [True]
