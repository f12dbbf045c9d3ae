"""What a window of events came to: counts, times and what was lost, beside its depth."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from .errors import RollerError

_START, _END, _EVENTS, _POINTS, _CPU, _STAGE, _LOST = (
    "start_ns", "end_ns", "events", "points", "cpu_ms", "ms ", "lost"
)  # fmt: skip


class AccountError(RollerError):
    """A message that isn't the account of a window."""


@dataclass(frozen=True)
class WindowAccount:
    """The account of one window, or of one block of the surface's rows."""

    #: The window, ROS time, ns.
    start_ns: int
    end_ns: int
    #: Events in it, and points measured.
    events: int
    points: int
    #: Wall time by stage, ms; empty for a window that was refused.
    milliseconds: dict[str, float] = field(default_factory=dict)
    #: Processor time of all threads of the process meanwhile, ms.
    cpu_ms: float = 0.0
    #: What was lost or refused, one line each.
    lost: tuple[str, ...] = ()

    def pairs(self) -> list[tuple[str, str]]:
        """The account as names and values, for a message of texts."""
        counts = (
            (_START, self.start_ns), (_END, self.end_ns),
            (_EVENTS, self.events), (_POINTS, self.points), (_CPU, f"{self.cpu_ms:.3f}"),
        )  # fmt: skip
        stages = ((_STAGE + stage, f"{ms:.3f}") for stage, ms in self.milliseconds.items())
        return [
            *((name, str(value)) for name, value in counts),
            *stages,
            *((_LOST, reason) for reason in self.lost),
        ]

    @classmethod
    def of_pairs(cls, pairs: Iterable[tuple[str, str]]) -> WindowAccount:
        """The account that `pairs` gave.

        Raises
        ------
        AccountError
            If a count is missing or isn't a number.
        """
        values: dict[str, str] = {}
        stages: dict[str, float] = {}
        lost = []
        try:
            for name, value in pairs:
                if name == _LOST:
                    lost.append(value)
                elif name.startswith(_STAGE):
                    stages[name.removeprefix(_STAGE)] = float(value)
                else:
                    values[name] = value
            start, end, events, points = (
                int(values[name]) for name in (_START, _END, _EVENTS, _POINTS)
            )
            cpu_ms = float(values[_CPU])
        except KeyError as error:
            raise AccountError(f"account of a window without {error.args[0]}") from error
        except ValueError as error:
            raise AccountError(f"account of a window: {error}") from error
        return cls(start, end, events, points, stages, cpu_ms, tuple(lost))


def account_of(message: Any) -> WindowAccount:
    """The account in a DiagnosticArray, rclpy's or rosbags'.

    Raises
    ------
    AccountError
        If it holds none.
    """
    values = [value for status in message.status for value in status.values]
    return WindowAccount.of_pairs((value.key, value.value) for value in values)
