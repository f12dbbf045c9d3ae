"""The calibration of the camera whose events are followed."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any, Generic, TypeVar

from .sources import OneSource, publisher_of, same_process

M = TypeVar("M")


class CameraSource(OneSource, Generic[M]):
    """Keeps to the camera_info of the process whose events are followed, where it sends one.

    It may be sent once and never again, so what each publisher said is kept.
    """

    def __init__(self) -> None:
        super().__init__(latched=True)
        self._said: dict[bytes, M] = {}

    def take(self, message: M, info: Mapping[str, Any], events: bytes | None) -> M | None:
        """Take a message.

        Parameters
        ----------
        message : M
            What a publisher says.
        info : mapping
            rclpy's `MessageInfo` of it.
        events : bytes or None
            The publisher of events that is followed.

        Returns
        -------
        M or None
            What holds from now on; None: what held before.
        """
        if (sender := publisher_of(info)) is not None:
            self._said[sender] = message
        return message if self.accepts(info) else self.of_events(events)

    def of_events(self, events: bytes | None) -> M | None:
        """Go over to the process of a publisher of events; returns as of `take`."""
        if not same_process(self.followed, events):
            for sender in self._said:
                if same_process(sender, events):
                    return self._go_over_to(sender)
        return None

    def check(self, alive: Collection[bytes]) -> M | None:
        """Go over to another when the followed one isn't among the living; as of `take`."""
        self._said = {k: m for k, m in self._said.items() if k in alive}
        self.keep_to(alive)
        if self.followed is None and self._said:
            return self._go_over_to(next(iter(self._said)))
        return None

    def _go_over_to(self, sender: bytes) -> M:
        self.follow(sender)
        return self._said[sender]
