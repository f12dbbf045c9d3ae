"""What is measured: a scan, a method with its settings and a measure, as plain data."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from roller_core.digests import data_digest
from roller_core.frame_settings import DEFAULT_SMOOTHING
from roller_emvs.depth_settings import DepthSettings
from roller_emvs.methods.surface import SurfaceSettings
from roller_sim.cell_settings import VirtualCellSettings

Overrides = Mapping[str, Any]

#: Methods by the name that tables give them: settings that differ from the defaults.
METHODS: dict[str, dict[str, Any]] = {
    "emvs": {"method": "emvs"},
    "left_right": {"method": "left_right"},
    "bma": {"method": "bma"},
    # The paper doesn't give the weights of its five views.
    "bma_5": {
        "method": "bma",
        "paper.reference_views": (0.0, 0.25, 0.5, 0.75, 1.0),
        "paper.weights": (0.2,) * 5,
    },
    "focus": {"method": "focus"},
    "surface": {"method": "surface"},
}


def depth_settings(method: str, **changes: Any) -> DepthSettings:
    """Settings of a method that makes depth maps, one of `METHODS`."""
    return DepthSettings.create({**METHODS[method], **changes}, method)


@dataclass(frozen=True)
class ScanCase:
    """A scan of the virtual cell."""

    #: Scene of the virtual cell.
    scene: str
    #: m/s.
    speed: float
    #: Seed of all chance.
    seed: int = 1
    #: Other settings of the virtual cell that differ from its defaults, by group as in a parameter
    #: file: light, sensor, contact.
    cell: Overrides = field(default_factory=dict, hash=False)
    #: Later poses that each waits for so that its stamp is smoothed, as the node does it.
    pose_smoothing: int = DEFAULT_SMOOTHING

    def settings(self, threads: int = 1) -> VirtualCellSettings:
        """Settings of the virtual cell in full; threads change nothing but the time it takes.

        Raises
        ------
        SettingsError
            If one of them is no good.
        """
        values: dict[str, Any] = copy.deepcopy(dict(self.cell))
        values.setdefault("scene", {})["name"] = self.scene
        values.setdefault("motion", {})["speed"] = self.speed
        # Pictures for people would only take time.
        values.setdefault("clock", {})["image_rate_hz"] = 0.0
        return VirtualCellSettings.create(
            {**values, "seed": self.seed, "threads": threads}, "evaluation"
        )

    def changed(self, **groups: Overrides) -> ScanCase:
        """The same scan with other settings of the virtual cell, group by group."""
        cell = {k: {**self.cell.get(k, {}), **v} for k, v in groups.items()}
        return replace(self, cell={**self.cell, **cell})

    @property
    def key(self) -> str:
        """The same for scans that come to the same events."""
        return data_digest([self.settings().model_dump(mode="json"), self.pose_smoothing])


@dataclass(frozen=True)
class Case:
    """A measurement."""

    #: The scan.
    scan: ScanCase
    #: What is measured, of `measures.MEASURES`.
    measure: str
    #: Of `METHODS`, or of what else the measure knows.
    method: str
    #: Settings of the method, or of the measure, that differ from the defaults.
    settings: Overrides = field(default_factory=dict, hash=False)
    #: Columns of the case's rows by which tables know it; they change no figure.
    labels: Overrides = field(default_factory=dict, hash=False)

    @property
    def depth(self) -> DepthSettings | SurfaceSettings:
        """Settings of the depth method in full; one thread unless said otherwise.

        Raises
        ------
        SettingsError
            If one of them is no good.
        """
        changes = {"threads": 1, **self.settings}
        if self.method == "surface":
            return SurfaceSettings.create(changes, self.method)
        return depth_settings(self.method, **changes)

    @property
    def key(self) -> str:
        """The same for cases that come to the same figures."""
        return data_digest([self.scan.key, self.measure, self.method, dict(self.settings)])

    @property
    def columns(self) -> dict[str, Any]:
        """What of the case stands in each of its rows."""
        scan = self.scan
        own = {"scene": scan.scene, "speed": scan.speed, "seed": scan.seed}
        return {**own, "measure": self.measure, "method": self.method, **self.labels}
