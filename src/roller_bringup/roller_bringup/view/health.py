"""What nodes say of themselves, and what the whole is like: for who stands three metres away."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

#: A node says something once a second; silent for this long, it is gone, s.
SILENT_S = 4.0
#: Slower is standing, m/s.
_STANDING_M_S = 1e-3
_LEVELS = ("good", "warn", "bad", "bad")
#: What to do, by what a status and its message say; the first that fits counts.
_ADVICE = tuple(
    (re.compile(pattern), advice)
    for pattern, advice in (
        (
            r"event_camera: .*(looking for|sends nothing|plugged|went away|reading failed|stalled)",
            "Check the camera's cable and power; `roller doctor --camera` looks for it.",
        ),
        (r"stop all but one|stop the other", "Stop one, or set another ROS_DOMAIN_ID."),
        (r"not calibrated|camera_info", "Set camerainfo_url: docs/commissioning.md, intrinsics."),
        (
            r"ur10: .*(looking for|can't be reached|connection was lost|nothing came)",
            "Check the robot's power, network and robot_ip; "
            "`roller doctor --robot-ip ADDRESS` tries it.",
        ),
        (r"use_sim_time", "Start the cell without use_sim_time; it is for replays."),
        (r"no numbers", "Start the robot's controller again, and check its tool centre point."),
        (r"the robot stands", "Clear the stop on the robot's pendant, then start the pass again."),
        (r"hand_eye", "Calibrate the camera's place: `roller calibrate hand-eye`."),
        (
            r"contact lost|too lightly",
            "Lower the roller onto the part, or raise the force of the recipe.",
        ),
        (
            r"slipping",
            "Roll slower or press harder, and see that the roller's bearings turn freely.",
        ),
        (r"pressed too hard", "Lower the force: the skin and its light change beyond their range."),
        (r"poses? (were )?missed|pose gap", "Wire the robot directly; see `roller doctor`."),
        (
            r"too slow|left out",
            "Roll slower, choose a faster method, or end other programs.",
        ),
        (r"disk", "Free the disk or record to a faster one."),
        (r"never came|lost", "Data were lost: use USB 3 and a direct network; `roller doctor`."),
        (r"another node|more than one|publish", "Stop one, or set another ROS_DOMAIN_ID."),
        (r"transform|tf|pose", "Start the robot's node, and check frames and tf_prefix."),
        (r"clock", "The clocks settle by themselves within seconds; then roll the pass again."),
        (r"coverage|texture|dark", "The skin shows too little: check light, coating and contact."),
    )
)


@dataclass
class Node:
    """The newest status of a node."""

    name: str
    level: int = 0
    message: str = ""
    values: dict[str, str] = field(default_factory=dict)
    seen_s: float = 0.0

    def gone(self, now_s: float) -> bool:
        """Whether it says nothing any more."""
        return now_s - self.seen_s > SILENT_S

    @property
    def finished(self) -> bool:
        """Whether it said that it has nothing more to do."""
        return self.message == "finished"

    def shown(self, now_s: float) -> dict[str, Any]:
        """What the page has of it."""
        level, message = _LEVELS[min(self.level, 3)], self.message
        advice = advice_for(self.name, message) if level != "good" else ""
        if self.gone(now_s):
            level = "idle" if self.finished else "gone"
            if not self.finished:
                message = f"says nothing for {now_s - self.seen_s:.0f} s (last: {message})"
                advice = "It ended or hangs: see its terminal, and start it again."
        return {
            "name": self.name,
            "level": level,
            "message": message,
            "advice": advice,
            "values": self.values,
        }


def advice_for(name: str, message: str) -> str:
    """What to do about a status that isn't well."""
    text = f"{name} {message}"
    for pattern, advice in _ADVICE:
        if pattern.search(text):
            return advice
    return "docs/graph.md explains the keys of its status; `roller doctor` checks the cell."


def number(nodes: Iterable[Node], *keys: str) -> float | None:
    """The first figure of some keys that a node gives."""
    for node in nodes:
        for key in keys:
            try:
                value = float(node.values[key])
            except (KeyError, ValueError):
                continue
            if math.isfinite(value):  # JSON, and so the page, knows no other numbers
                return value
    return None


def overall(nodes: Mapping[str, Node], speed_m_s: float | None, now_s: float) -> dict[str, str]:
    """State of the whole in a word, its level, and why."""
    if not nodes:
        return {"word": "NO CELL", "level": "idle", "detail": "no node says anything yet"}
    alive = [node for node in nodes.values() if not node.gone(now_s)]
    if not alive:
        return {"word": "STOPPED", "level": "idle", "detail": "no node runs any more"}
    lost = [n for n in nodes.values() if n.gone(now_s) and not n.finished]
    if lost:
        names = ", ".join(node.name.partition(":")[0] for node in lost)
        return {"word": "NODE LOST", "level": "bad", "detail": f"{names}: no sign of life"}
    worst = max(alive, key=lambda node: node.level)
    if worst.level >= 2:
        return {"word": "DATA BAD", "level": "bad", "detail": f"{worst.name}: {worst.message}"}
    detail = f"{worst.name}: {worst.message}" if worst.level else ""
    if speed_m_s is None and any(node.finished for node in alive):
        return {"word": "FINISHED", "level": "idle", "detail": detail}
    if speed_m_s is None:
        return {"word": "WAITING", "level": "warn", "detail": detail or "no pose of the robot yet"}
    rolling = speed_m_s > _STANDING_M_S
    return {
        "word": "ROLLING" if rolling else "STANDING",
        "level": "warn" if worst.level else "good" if rolling else "idle",
        "detail": detail,
    }
