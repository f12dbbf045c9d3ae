"""What a stage may be asked, as services of its node."""

from __future__ import annotations

import time
from collections.abc import Callable

from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import Trigger

from . import diagnostics
from .work_left import WorkLeft

#: How long a service waits for nodes that still work on what came, s.
_PATIENCE_S = 10.0


class PatientAnswers:
    """Waits until what came by now is processed, by this node and those before it.

    Parameters
    ----------
    node : Node
        The one that is asked.
    waiting : callable
        How many messages wait in it.
    """

    def __init__(self, node: Node, waiting: Callable[[], int]) -> None:
        self._node, self._waiting = node, waiting
        self._others = WorkLeft(node)

    async def all_that_came(self) -> str:
        """Wait; the nodes that still work on it after `_PATIENCE_S`, empty: none."""
        done, asked = Future[str](), self._others.ask()
        end_s = time.monotonic() + _PATIENCE_S

        def look() -> None:
            left = asked.unfinished
            here = not left and self._waiting() == 0
            if not done.done() and (here or time.monotonic() > end_s):
                done.set_result(left)

        timer = self._node.create_timer(0.05, look, clock=diagnostics.STEADY)
        try:
            return await done
        finally:
            asked.open = False
            self._node.destroy_timer(timer)


def offer(
    node: Node, name: str, act: Callable[[str], tuple[bool, str]], patient: PatientAnswers | None
) -> None:
    """Offer a service ~/name.

    Parameters
    ----------
    node : Node
        Whose service it is.
    name : str
        Its name.
    act : callable
        Takes what still works on what came, and gives whether it went well and what to say.
    patient : PatientAnswers, optional
        Waits for what came; without it the answer is of what is done by now.
    """
    asked: list[Future[tuple[bool, str]]] = []

    async def serve(_: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        if asked:  # meanwhile again: it is of the same
            response.success, response.message = await asked[0]
            return response
        asked.append(Future[tuple[bool, str]]())
        try:
            late = await patient.all_that_came() if patient else ""
            response.success, response.message = act(late)
        finally:
            asked.pop().set_result((response.success, response.message))
        return response

    # While it waits, others have their turn.
    node.create_service(Trigger, f"~/{name}", serve, callback_group=ReentrantCallbackGroup())
