"""Lights and coatings by name: settings of the virtual cell that differ from its defaults."""

from __future__ import annotations

from typing import Any

#: Settings by group, as in a parameter file.
Groups = dict[str, dict[str, Any]]

#: What the skin is lit and seen by. `strong` has the event rates of models in the literature:
#: less scattered light, a narrower lobe; and another sensor: threshold and noise of IEBCS and
#: v2e's middle, the pixel's bandwidth of IEBCS, the refractory period of v2e.
LIGHTS: dict[str, Groups] = {
    "ring": {},
    "dome": {"light": {"kind": "dome"}},
    "strong": {
        "light": {"kind": "strong"},
        "sensor": {
            "threshold": 0.25, "bandwidth_hz": 4000.0, "refractory_us": 500.0, "background_hz": 0.1,
        },
    },
}  # fmt: skip
#: What is printed on the skin.
COATINGS: dict[str, Groups] = {"plain": {}, "textured": {"light": {"speckle": 0.08}}}
