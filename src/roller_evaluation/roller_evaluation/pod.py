"""Probability of detection of the inspection on plates with labelled defects."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np

from roller_core.progress import OnProgress
from roller_inspect.findings import KINDS
from roller_sim.presets import COATINGS

from .cases import Case, ScanCase
from .coating import CAVEAT
from .pictures import write_picture
from .pod_curve import CONFIDENCE, POD, PodCurve, fit_pod, poisson_bound
from .rows import Row, mean, provenance, rounded, values, where, write_rows
from .run import run
from .tables import Table, number, share, write_json

METHOD = "surface"
#: Plates that the inspection may be tuned on have seeds from the first on, those of a report from
#: the second.
TUNING_SEED, REPORT_SEED = 1, 1001
#: Kinds that only a reference with the part's own features can name: to others they are a hollow
#: or a rise.
_OF_A_PART = ("missing", "extra")
_NOT_REACHED = "not reached"


@dataclass(frozen=True)
class PodOptions:
    """Size of the experiment."""

    #: Plates with defects, and without, of each coating and speed.
    plates: int = 10
    clean: int = 3
    #: A plate.
    defects: int = 42
    #: Of defects; flush rivets are there too, as what must not be found.
    kinds: tuple[str, ...] = KINDS
    #: Ladders of sizes.
    depths_mm: tuple[float, ...] = (0.03, 0.05, 0.07, 0.1, 0.14, 0.2, 0.28, 0.4)
    widths_mm: tuple[float, ...] = (1.0, 2.0, 3.0)
    #: m/s.
    speeds: tuple[float, ...] = (0.3, 0.5)
    #: Of the virtual cell's `COATINGS`.
    coatings: tuple[str, ...] = ("textured", "plain")
    #: Of the first plate.
    seed: int = REPORT_SEED
    #: Other settings of the virtual cell by group.
    cell: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def short(cls, **changes: Any) -> PodOptions:
        """A plate of a few large defects and a clean one, seen by part of the camera."""
        small = cls(
            plates=1, clean=1, defects=6, depths_mm=(0.1, 0.3), widths_mm=(2.0,), speeds=(0.3,),
            coatings=("textured",),
            cell={"camera": {"width": 320, "height": 64, "focal_px": 533.0},
                  "scene": {"step_mm": 0.06}},
        )  # fmt: skip
        return replace(small, **changes)


def pod_cases(options: PodOptions) -> list[Case]:
    """Plates of each coating and speed; the same plates for all of them."""
    o = options
    scene: dict[str, Any] = {
        "margin_mm": 2.0, "defects": o.defects, "defect_kinds": [*o.kinds, "rivet_flush"],
        "defect_depths_mm": list(o.depths_mm), "defect_widths_mm": list(o.widths_mm),
    }  # fmt: skip
    names = ["defects"] * o.plates + ["clean"] * o.clean
    cases = []
    for coating in o.coatings:
        for speed in o.speeds:
            for k, name in enumerate(names):
                scan = ScanCase(name, speed, o.seed + k, o.cell).changed(**COATINGS[coating])
                scan = scan.changed(scene={**scene, **o.cell.get("scene", {}), "seed": o.seed + k})
                cases.append(Case(scan, "detection", METHOD, {}, {"coating": coating}))
    return cases


def run_pod(
    options: PodOptions, output: Path, *, jobs: int, on_progress: OnProgress
) -> dict[str, Any]:
    """Inspect plates, and write `pod.json`, `rows.csv` and `pod.png`.

    Parameters, errors and what is kept are those of `run.run`; the result is `pod.json`: `rows` of
    defects and plates, and what `summarise` makes of them.
    """
    rows = run(pod_cases(options), output / "passes", jobs=jobs, on_progress=on_progress)
    result: dict[str, Any] = {
        "facts": {**provenance(), "of": CAVEAT, "seeds": _seeds(options)},
        "options": asdict(options),
        "rows": rows,
        **summarise(rows),
    }
    write_json(result, output / "pod.json")
    write_rows(rows, output / "rows.csv")
    draw(rows, output / "pod.png")
    return result


def summarise(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Curves with sizing errors by coating, speed and kind, and false calls by coating and speed.

    Returns
    -------
    dict
        `curves` and `false_calls`, rows each. Errors of depth are against the depth to which the
        skin follows.
    """
    curves, calls = [], []
    for labels, own in _conditions(rows):
        for kind, targets in _by_kind(own):
            curve = _fitted(targets)
            hit = where(targets, hit=True)
            off = [r["found_depth_um"] - r["skin_um"] for r in hit]
            held = [abs(e) <= r["u_depth_um"] for e, r in zip(off, hit, strict=True)]
            named = [r["found_kind"] == r["kind"] for r in hit if r["kind"] not in _OF_A_PART]
            sizes = {f"{side}_off_mm": [r[f"found_{side}_mm"] - r[f"{side}_mm"] for r in hit]
                     for side in ("length", "width")}  # fmt: skip
            spanned = [abs(r[f"found_{side}_mm"] - r[f"{side}_mm"]) <= r[f"u_{side}_mm"]
                       for r in hit for side in ("length", "width")]  # fmt: skip
            curves.append(
                {
                    **labels, "kind": kind, "targets": curve.targets, "hits": curve.hits,
                    "a90_um": rounded(curve.a90), "a90_95_um": rounded(curve.a90_95),
                    "depth_mae_um": rounded(np.mean(np.abs(off)) if off else None),
                    "depth_bias_um": rounded(np.median(off) if off else None),
                    **{name: rounded(np.median(v) if v else None, 3) for name, v in sizes.items()},
                    "depth_within_u": rounded(np.mean(held) if held else None, 3),
                    "sides_within_u": rounded(np.mean(spanned) if spanned else None, 3),
                    "kind_right": rounded(np.mean(named) if named else None, 3),
                }
            )  # fmt: skip
        plates = where(own, role="plate")
        count, area = sum(r["false_calls"] for r in plates), sum(r["area_m2"] for r in plates)
        clean = where(plates, scene="clean")
        calls.append(
            {
                **labels, "false_calls": count, "area_m2": area,
                "per_m2": count / area if area else None,
                "per_m2_95": poisson_bound(count, area) if area else None,
                "clean_calls": sum(r["false_calls"] for r in clean),
                "clean_area_m2": sum(r["area_m2"] for r in clean),
                "measured": mean(plates, "measured"), "continued": mean(plates, "continued"),
            }
        )  # fmt: skip
    return {"curves": curves, "false_calls": calls}


def tables(result: dict[str, Any]) -> list[Table]:
    """Curves by coating, speed and kind; shares found by depth; false calls."""
    curves = [
        (
            _name(c), c["kind"], f"{c['hits']} of {c['targets']}", _size(c["a90_um"]),
            _size(c["a90_95_um"]), number(c["depth_mae_um"], 0), number(c["depth_bias_um"], 0),
            share(c["depth_within_u"]), number(c["length_off_mm"], 2),
            number(c["width_off_mm"], 2), share(c["sides_within_u"]), share(c["kind_right"]),
        )
        for c in result["curves"]
    ]  # fmt: skip
    head: tuple[str, ...] = (
        "coating, m/s", "kind", "found", "a90 µm", "a90/95 µm", "depth error µm", "bias",
        "within U", "length mm", "width mm", "within U", "kind right",
    )  # fmt: skip
    note = (
        f"{CAVEAT} Seeds {result['facts']['seeds']}. a: depth of the relief; a90 is found with a "
        f"probability of {POD:.0%} (logit on ln a), a90/95 is its upper bound at {CONFIDENCE:.0%} "
        f'(profile likelihood); "{_NOT_REACHED}" where that is beyond the deepest target. Depth '
        "errors of those found, mean and median, against the depth to which the skin follows; "
        "length and width: median difference from the relief's. Scratches are 0.3 to 1 mm wide. "
        "The reference is the scan itself, to which missing pieces are dents and extra ones raised."
    )
    found = [Table("Probability of detection", head, curves, note)]
    defects = where(result["rows"], role="defect")
    depths = sorted({abs(r["depth_um"]) for r in defects})
    by_depth = [
        (_name(labels), *(share(mean([r for r in own if abs(r["depth_um"]) == d], "hit"))
                          for d in depths))
        for labels, own in _conditions(defects)
    ]  # fmt: skip
    head = ("coating, m/s", *(f"{d:.0f} µm" for d in depths))
    found.append(Table("Share found by depth, all kinds", head, by_depth))
    calls = [
        (
            _name(c), str(c["false_calls"]), number(c["area_m2"] * 1e6, 0), number(c["per_m2"], 0),
            number(c["per_m2_95"], 0), f"{c['clean_calls']} on {c['clean_area_m2'] * 1e6:.0f} mm²",
            share(c["measured"]), share(c["continued"]),
        )
        for c in result["false_calls"]
    ]  # fmt: skip
    head = ("coating, m/s", "false calls", "mm²", "per m²", "at most", "clean plates alone",
            "measured", "continued")  # fmt: skip
    note = (
        f'Findings that touch neither a defect nor a flush rivet; "at most": Poisson bound at '
        f"{CONFIDENCE:.0%}. Shares are of the scanned area. {CAVEAT}"
    )
    return [*found, Table("False calls", head, calls, note)]


def draw(rows: Sequence[Row], path: Path) -> None:
    """Draw the curves by kind, with the share found at each depth."""
    conditions = list(_conditions(where(rows, role="defect")))
    figure, axes = plt.subplots(
        1, max(len(conditions), 1), figsize=(max(4.6 * len(conditions), 6), 4.8), dpi=90,
        layout="constrained", sharey=True, squeeze=False,
    )  # fmt: skip
    for axis, (labels, own) in zip(axes[0], conditions, strict=False):
        depths = np.array([abs(r["depth_um"]) for r in own])
        line = np.geomspace(depths.min(), depths.max(), 100)
        for k, (kind, targets) in enumerate(_by_kind(own)):
            style = (
                {"color": "black", "lw": 2.2} if kind == "all" else {"color": f"C{k}", "lw": 1.2}
            )
            curve = _fitted(targets)
            axis.plot(line, 100 * curve.at(line), label=f"{kind}, {curve.targets}", **style)
            if kind == "all" and curve.a90_95 is not None:
                axis.axvline(curve.a90_95, color="grey", ls=":", lw=1)
                axis.text(curve.a90_95, 4, f" a90/95 {curve.a90_95:.0f} µm", fontsize=8)
        found = {d: 100 * float(np.mean(values([r for r in own if abs(r["depth_um"]) == d], "hit")))
                 for d in sorted(set(depths.tolist()))}  # fmt: skip
        axis.plot(list(found), list(found.values()), "ko", ms=4)
        axis.axhline(100 * POD, color="grey", lw=0.8)
        axis.set(
            xscale="log", xlabel="depth of the relief, µm", title=_name(labels), ylim=(-3, 103)
        )
        ticks = list(found)
        axis.set_xticks(ticks, [f"{t:.0f}" for t in ticks], fontsize=8)
        axis.minorticks_off()
        axis.grid(alpha=0.25)
        axis.legend(
            fontsize=7, title="kind, targets", title_fontsize=7, loc="upper center",
            bbox_to_anchor=(0.5, -0.13), ncols=4,
        )  # fmt: skip
    axes[0, 0].set_ylabel("probability of detection, %; dots: share found, all kinds")
    figure.suptitle(f"Probability of detection. {CAVEAT}", fontsize=11)
    write_picture(figure, path)


def _conditions(rows: Sequence[Row]) -> Iterator[tuple[Row, list[Row]]]:
    for coating, speed in dict.fromkeys((r["coating"], r["speed"]) for r in rows):
        yield {"coating": coating, "speed": speed}, where(rows, coating=coating, speed=speed)


def _by_kind(rows: Sequence[Row]) -> Iterator[tuple[str, list[Row]]]:
    """Defects of each kind, then all."""
    defects = where(rows, role="defect")
    for kind in (k for k in KINDS if any(r["kind"] == k for r in defects)):
        yield kind, where(defects, kind=kind)
    if defects:
        yield "all", defects


def _fitted(targets: Sequence[Row]) -> PodCurve:
    return fit_pod([abs(r["depth_um"]) for r in targets], [r["hit"] for r in targets])


def _name(labels: Row) -> str:
    return f"{labels['coating']}, {labels['speed']:g}"


def _size(um: float | None) -> str:
    return _NOT_REACHED if um is None else f"{um:.0f}"


def _seeds(o: PodOptions) -> str:
    last = o.seed + o.plates + o.clean - 1
    kind = "of reports" if o.seed >= REPORT_SEED else "that the inspection may be tuned on"
    return f"{o.seed} to {last}, {kind}"
