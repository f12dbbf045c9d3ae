"""Which skin to print: error, measured area and rate of events by the coating's speckle."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
from matplotlib.axes import Axes

from roller_core.progress import OnProgress
from roller_sim.cell_settings import LightSettings, SensorSettings
from roller_sim.presets import COATINGS

from .cases import Case, ScanCase
from .pictures import write_picture
from .rows import Row, mean, provenance, values, where, write_rows
from .run import run
from .tables import Table, number, share, write_json

METHOD = "surface"
#: The skin to print measures at least this share of what the best does, errs at most this much
#: more than the best, and is of those the one with the fewest events.
_LEAST_AREA, _MOST_ERROR = 0.9, 1.25
#: Most events a second at any speed, 10⁶: two cores take them as they come at 50 ns each.
_MOST_EVENTS = 40.0
#: Share of the cells that a skin must measure to be named at all.
_ENOUGH = 0.3
_GRAIN_MM = LightSettings.create({}).speckle_mm
_THRESHOLD = SensorSettings.create({}).threshold
CAVEAT = "Virtual cell, not fitted to a real roller."


@dataclass(frozen=True)
class CoatingOptions:
    """Size of the experiment."""

    #: RMS of the reflectance.
    contrasts: tuple[float, ...] = (0.03, 0.05, 0.08, 0.12, 0.18)
    #: Correlation length, mm. No less than 0.1 mm, 2.4 px: the virtual lens is sharper than any
    #: real one, and would find finer grains better than they are.
    grains_mm: tuple[float, ...] = (0.1, 0.16, 0.25)
    #: Of the sensor; tried at the default grain.
    thresholds: tuple[float, ...] = (0.15, _THRESHOLD, 0.3)
    #: m/s; the thresholds are tried at the first.
    speeds: tuple[float, ...] = (0.3, 0.1, 0.5)
    #: Seed of all chance.
    seed: int = 1
    #: Other settings of the virtual cell by group: a plate of dents, bumps and missing pieces, a
    #: third of the camera's rows.
    cell: Mapping[str, Any] = field(
        default_factory=lambda: {
            "camera": {"height": 160},
            "scene": {
                "margin_mm": 2.0, "defects": 9, "defect_kinds": ["dent", "raised", "missing"],
                "defect_depths_mm": [0.1, 0.2], "defect_widths_mm": [2.0, 3.0],
            },
        }
    )  # fmt: skip

    @classmethod
    def short(cls, **changes: Any) -> CoatingOptions:
        """Two contrasts and one speed, seen by few rows."""
        small = cls(contrasts=(0.03, 0.08), grains_mm=(_GRAIN_MM,), thresholds=(), speeds=(0.3,))
        scene = {**small.cell["scene"], "step_mm": 0.04, "defects": 3}
        cell = {"camera": {"height": 48}, "scene": scene}
        return replace(small, **{"cell": cell, **changes})


def coating_cases(options: CoatingOptions) -> list[Case]:
    """Contrasts by grain and speed, and contrasts by threshold; each once."""
    o = options
    wanted = [
        (contrast, grain, _THRESHOLD, speed)
        for speed in o.speeds for grain in o.grains_mm for contrast in o.contrasts
    ] + [
        (contrast, _GRAIN_MM, threshold, o.speeds[0])
        for threshold in o.thresholds for contrast in o.contrasts
    ]  # fmt: skip
    cases = []
    for contrast, grain, threshold, speed in dict.fromkeys(wanted):
        scan = ScanCase("defects", speed, o.seed, o.cell).changed(
            light={"speckle": contrast, "speckle_mm": grain}, sensor={"threshold": threshold}
        )
        labels = {"contrast": contrast, "grain_mm": grain, "threshold": threshold}
        cases.append(Case(scan, "coverage", METHOD, {}, labels))
    return cases


def run_coating(
    options: CoatingOptions, output: Path, *, jobs: int, on_progress: OnProgress
) -> dict[str, Any]:
    """Measure coatings, and write `coating.json`, `rows.csv` and `coating.png`.

    Parameters, errors and what is kept are those of `run.run`; the result is `coating.json`:
    `rows`, and the skin to print as `recommended`.
    """
    rows = run(coating_cases(options), output / "passes", jobs=jobs, on_progress=on_progress)
    result = {
        "facts": {**provenance(), "of": CAVEAT},
        "options": asdict(options),
        "rows": rows,
        "recommended": recommended(rows),
    }
    write_json(result, output / "coating.json")
    write_rows(rows, output / "rows.csv")
    draw(rows, options, output / "coating.png")
    return result


def recommended(rows: Sequence[Row]) -> Row | None:
    """The skin to print: contrast and grain with their means over the speeds; None without any.

    Of those whose events can be computed as they come and that measure enough of the surface,
    nearly as much as the best of them, and err little more, the one with the fewest events.
    """
    base = where(rows, threshold=_THRESHOLD)
    skins = []
    for contrast, grain in dict.fromkeys((r["contrast"], r["grain_mm"]) for r in base):
        own = where(base, contrast=contrast, grain_mm=grain)
        columns = ("mae_um", "measured", "points_per_mm2", "mev_per_s")
        rates = values(own, "mev_per_s")
        if len(values(own, "mae_um")) == len(own) and max(rates) <= _MOST_EVENTS:
            skins.append({"contrast": contrast, "grain_mm": grain}
                         | {column: mean(own, column) for column in columns})  # fmt: skip
    skins = [s for s in skins if s["measured"] >= _ENOUGH]
    if not skins:
        return None
    most = max(s["measured"] for s in skins)
    wide = [s for s in skins if s["measured"] >= _LEAST_AREA * most]
    least = min(s["mae_um"] for s in wide)
    good = [s for s in wide if s["mae_um"] <= _MOST_ERROR * least]
    return min(good, key=lambda s: s["mev_per_s"])


def verdict(found: Row | None) -> str:
    """The skin to print, in words."""
    if found is None:
        return (
            f"None of these coatings measures {_ENOUGH:.0%} of the cells of 0.1 mm with at most "
            f"{_MOST_EVENTS:g} million events a second. {CAVEAT}"
        )
    return (
        f"Skin to print: a random texture of {found['contrast']:.0%} RMS contrast and "
        f"{found['grain_mm']:g} mm grain (distance at which its correlation falls to 1/e). Over "
        f"the speeds it measures {found['measured']:.0%} of the cells of 0.1 mm with a mean error "
        f"of {found['mae_um']:.1f} µm, at {found['mev_per_s']:.0f} million events a second: of the "
        f"good ones with at most {_MOST_EVENTS:g} million at any speed that with the fewest. "
        f"{CAVEAT}"
    )


def tables(result: dict[str, Any]) -> list[Table]:
    """By speed, grain and contrast; and by threshold."""
    rows = result["rows"]
    presets = {
        LightSettings.create(groups.get("light", {})).speckle: name
        for name, groups in COATINGS.items()
    }

    def cells(own: Sequence[Row], *columns: str) -> list[tuple[str, ...]]:
        out = []
        for r in own:
            name = presets.get(r["contrast"], "") if r["grain_mm"] == _GRAIN_MM else ""
            contrast = f"{r['contrast']:.0%}" + (f" ({name})" if name else "")
            out.append(
                (
                    *(f"{r[column]:g}" for column in columns), contrast, number(r["mae_um"]),
                    number(r["median_um"]), share(r["measured"]), number(r["points_per_mm2"], 0),
                    number(r["mev_per_s"]),
                )
            )  # fmt: skip
        return out

    figures = ("contrast", "mean error µm", "median", "measured", "points/mm²", "10⁶ events/s")
    note = (
        "Mean and median absolute error of all points of `surface`, the share of cells of 0.1 mm "
        "that hold one, and events a second of the whole sensor, scaled from the rows simulated."
    )
    out = [
        Table(
            "Coatings by speed and grain", ("m/s", "grain mm", *figures),
            cells(where(rows, threshold=_THRESHOLD), "speed", "grain_mm"),
            note,
        )
    ]  # fmt: skip
    others = [r for r in rows if r["threshold"] != _THRESHOLD]
    if others:
        speed = others[0]["speed"]
        own = sorted(where(rows, speed=speed, grain_mm=_GRAIN_MM), key=lambda r: r["threshold"])
        title = f"Coatings by the sensor's threshold, {speed:g} m/s, grain {_GRAIN_MM:g} mm"
        out.append(Table(title, ("threshold", *figures), cells(own, "threshold")))
    return out


def draw(rows: Sequence[Row], options: CoatingOptions, path: Path) -> None:
    """Draw error, measured share and rate of events against contrast."""
    o = options
    kinds = [
        (f"grain {_GRAIN_MM:g} mm, by speed", "speed", "m/s", o.speeds,
         {"grain_mm": _GRAIN_MM, "threshold": _THRESHOLD}),
        (f"{o.speeds[0]:g} m/s, by grain", "grain_mm", "mm", o.grains_mm,
         {"speed": o.speeds[0], "threshold": _THRESHOLD}),
        (f"{o.speeds[0]:g} m/s, grain {_GRAIN_MM:g} mm, by threshold", "threshold", "",
         o.thresholds, {"speed": o.speeds[0], "grain_mm": _GRAIN_MM}),
    ]  # fmt: skip
    kinds = [kind for kind in kinds if kind[3]]
    figure, axes = plt.subplots(
        3, len(kinds), figsize=(4.4 * len(kinds), 9), dpi=90, layout="constrained", sharex=True,
        sharey="row", squeeze=False,
    )  # fmt: skip
    names = {"mae_um": "mean error, µm", "measured": "cells measured, %",
             "mev_per_s": "10⁶ events a second"}  # fmt: skip
    for k, (title, column, unit, steps, fixed) in enumerate(kinds):
        axes[0, k].set_title(title, fontsize=10)
        for i, (name, label) in enumerate(names.items()):
            axis: Axes = axes[i, k]
            for step in sorted(steps):
                own = sorted(where(rows, **fixed, **{column: step}), key=lambda r: r["contrast"])
                own = [r for r in own if r[name] is not None]
                factor = 100 if name == "measured" else 1
                x, y = ([f * r[c] for r in own] for f, c in ((100, "contrast"), (factor, name)))
                axis.plot(x, y, "o-", ms=4, label=f"{step:g} {unit}".strip())
            axis.grid(alpha=0.3)
            if k == 0:
                axis.set_ylabel(label)
            if name == "mev_per_s":
                axis.set_yscale("log")
                axis.set_xlabel("contrast of the coating, % RMS")
        axes[0, k].legend(fontsize=8)
    axes[0, 0].set_ylim(bottom=0)
    axes[1, 0].set_ylim(0, 100)
    figure.suptitle(f"What the skin's texture gives `surface`. {CAVEAT}", fontsize=11)
    write_picture(figure, path)
