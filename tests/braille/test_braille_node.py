"""The node that reads Braille."""

import pytest

pytest.importorskip("rclpy")

from roller_braille import braille_node
from roller_inspect import inspect_node


def test_on_busy_cores_text_comes_after_depth_and_before_inspection(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    given: list[int] = []
    for node in (braille_node, inspect_node):
        monkeypatch.setattr(node, "give_way", given.append)
        monkeypatch.setattr(node, "run_node", lambda make: 0)
        with pytest.raises(SystemExit):
            node.main()
    assert 0 < given[0] < given[1]
