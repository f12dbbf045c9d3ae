"""The paper's tables beside ours."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from . import paper_values as published
from .measured import Measured
from .plan import CONTACTS, FAST, FUSIONS, OURS, SPEED, EvaluationOptions
from .repeated_passes import Pass
from .tables import Table
from .weights import cross_validated, weight_choices

NAMES = {
    "emvs": "EMVS", "left_right": "left & right", "bma": "BMA", "bma_5": "BMA, five views",
    "focus": "focus", "surface": "surface",
}  # fmt: skip
CELLS = (
    "Mean absolute error, µm, ± standard deviation between passes, and in brackets the share of "
    "relief edges that have a depth within 2 px."
)

MEDIAN = (
    "The paper's methods take the median over 45 px, 1.9 mm on the surface: that quiets the votes' "
    "noise and levels what is narrower."
)


def tables(measured: Measured, options: EvaluationOptions) -> dict[str, Table]:
    """Tables by experiment, of those that were asked for."""
    makers: dict[str, Callable[[Measured, EvaluationOptions], Table]] = {
        "weights": weights, "fusion": fusion, "objects": objects, "speed": speed, "views": views,
        "lines": lines, "force": force, "large": large, "sensors": sensors,
    }  # fmt: skip
    return {name: make(measured, options) for name, make in makers.items() if name in options.only}


def weights(m: Measured, o: EvaluationOptions) -> Table:
    """The best weights of each object, tried on all (the paper's cross-validation)."""
    names = o.calibration_set
    rows = [
        (f"{name}, the paper", *(f"{w:.3f}" for w in values), f"{mean:.1f}", *("–" for _ in names))
        for name, (values, mean) in published.WEIGHTS.items()
        if name in names
    ]
    found = {
        name: [m.whole(p)["methods"]["weights"] for p in _passes(o, name)] for name in names
    }  # fmt: skip
    for best in cross_validated(found):
        cells = [f"{e:.1f} ({v:.1%})" for e, v in zip(best.error_um, best.measured, strict=True)]
        mean = f"{np.mean(best.error_um):.1f} ({np.mean(best.measured):.1%})"
        rows.append((best.name, *(f"{w:.3f}" for w in best.weights), mean, *cells))
    each = [_passes(o, name) for name in names]
    for method in ("focus", "surface"):
        own = [error(m, p, method) for p in each]
        rows.append((f"{NAMES[method]}, without", "–", "–", "–", mean_error(m, each, method), *own))
    note = (
        f"Of {len(weight_choices())} weights on the simplex those with the least mean absolute "
        "error, µm, over an object's passes, and their error over each object, with the share of "
        "its pixels in contact that have a depth (of focus and surface: of relief edges); they "
        "must measure at least 95 % of what any weights do. The paper finds most weight at the "
        "start in all three; the virtual cell has none of the reasons that it gives for that."
    )
    head = ("found on", "start", "middle", "end", "mean", *names)
    return Table("Weights of bma by object, 0.3 m/s", head, rows, note)


def fusion(m: Measured, o: EvaluationOptions) -> Table:
    """EMVS, left & right and BMA on the calibration set (the paper's first table of errors)."""
    names = o.calibration_set
    rows = [
        (f"{NAMES[k]}, the paper", *(f"{v[n]:.1f}" for n in names),
         f"{np.mean([v[n] for n in names]):.1f}")
        for k, v in published.FUSION_UM.items()
    ]  # fmt: skip
    for method in FUSIONS:
        each = [_passes(o, name) for name in names]
        rows.append(
            (NAMES[method], *(error(m, p, method) for p in each), mean_error(m, each, method))
        )
    each = [_passes(o, name) for name in names]
    errors, edges = (
        [_mean([m.mean(p, method, figure) for p in each]) for method in ("emvs", "bma")]
        for figure in ("mae_um", "edges_measured")
    )
    change = f"{errors[1] / errors[0] - 1:+.0%}" if errors[0] and errors[1] else "–"
    note = (
        f"{CELLS} Fusing three views changes the error of EMVS by {change} here and the edges "
        f"measured from {_share(edges[0])} to {_share(edges[1])}; in the paper it "
        "lowers the error by 25 %. The views "
        f"share a window's events, so their errors go together and fusing fills gaps. {MEDIAN}"
    )
    return Table("Depth methods at 0.3 m/s, µm", ("method", *names, "mean"), rows, note)


def objects(m: Measured, o: EvaluationOptions) -> Table:
    """All objects, mean and deviation over passes."""
    rows = []
    for name in o.objects:
        mean, deviation = published.OBJECTS_UM[name]
        mine = [error(m, _passes(o, name), method) for method in OURS]
        rows.append((name, f"{mean:.1f} ± {deviation:.1f}", *mine))
    each = [_passes(o, name) for name in o.objects]
    overall = [mean_error(m, each, method) for method in OURS]
    if len(o.objects) == len(published.OBJECTS_UM):
        mean, deviation = published.OVERALL_UM
    else:
        mean, deviation = np.mean([published.OBJECTS_UM[name] for name in o.objects], axis=0)
    rows.append(("all", f"{mean:.1f} ± {deviation:.1f}", *overall))
    head = ("object", "the paper (BMA)", *(NAMES[k] for k in OURS))
    note = f"{CELLS} {MEDIAN} The paper's masks are drawn by hand; here all of the skin is known."
    return Table("The six objects at 0.3 m/s, µm", head, rows, note)


def speed(m: Measured, o: EvaluationOptions) -> Table:
    """Errors on the sphere by speed, and what BMA gains on EMVS."""
    rows = []
    for v in o.speeds:
        own = _passes(o, "sphere", v)
        cells = [error(m, own, method) for method in FUSIONS]
        emvs, bma = (m.mean(own, k, "mae_um") for k in ("emvs", "bma"))
        gain = f"{1 - bma / emvs:.1%}" if emvs and bma else "–"
        paper = published.REDUCTION.get(v)
        rows.append((f"{v:g}", *cells, gain, f"{paper:.1%}" if paper else "–"))
    head = ("m/s", *(NAMES[k] for k in FUSIONS), "BMA against EMVS", "the paper")
    note = (
        f"{CELLS} Windows of 20 ms hold 1 mm of travel at 0.05 m/s and 10 mm at 0.5: the paper's "
        "methods gain with speed as their parallax does. Windows by travel don't need it; at speed "
        "they lose what pixels miss while they wait for their read-out."
    )
    return Table("The sphere by speed, µm", head, rows, note)


def views(m: Measured, o: EvaluationOptions) -> Table:
    """Three against five reference views."""
    own = _passes(o, "sphere")
    rows = [
        (
            {"bma": "three", "bma_5": "five"}[name],
            f"{mean:.1f} ± {deviation:.1f}",
            error(m, own, name),
        )
        for name, (mean, deviation) in published.VIEWS_UM.items()
    ]
    rows += [(f"one: {NAMES[k]}", "–", error(m, own, k)) for k in ("focus", "surface")]
    note = f"{CELLS} Weights of five views are equal; the paper doesn't give its own."
    head = ("reference views", "the paper", "here")
    return Table("Reference views, sphere at 0.3 m/s, µm", head, rows, note)


def lines(m: Measured, o: EvaluationOptions) -> Table:
    """Deviation of the height of three equal lines."""
    own = _passes(o, "three_lines", whole=True)
    rows = []
    for method in FUSIONS:
        paper = published.LINES_UM.get(method)
        spread, apart = m.mean(own, method, "spread_um"), []
        share = m.mean(own, method, "tops_measured")
        for asked in own:
            tops = m.whole(asked)["methods"][method]["tops_um"]
            means = [top["mean"] for top in tops if top]
            apart.append(np.ptp(means) if len(means) > 1 else np.nan)
        rows.append(
            (
                NAMES[method],
                f"{paper:.0f}" if paper else "–",
                f"{spread:.1f} ({share:.0%})" if spread is not None and share is not None else "–",
                _number(float(np.nanmean(apart)) if np.isfinite(apart).any() else None),
                error(m, own, method),
            )
        )
    head = ("method", "the paper", "deviation on top", "lines apart", "whole plate")
    note = (
        f"{CELLS} Deviation of the heights found on top of all lines, more than 0.2 mm from their "
        "walls, with the share of that area (cells of 0.1 mm) that holds a point, and how far the "
        "lines' means are apart. The tops are smooth: only the coating's speckle shows there."
    )
    return Table("Three equal lines of 0.6 mm at 0.3 m/s, µm", head, rows, note)


def force(m: Measured, o: EvaluationOptions) -> Table:
    """The bumps under three contact forces."""
    rows = []
    for contact in CONTACTS:
        own = [Pass("bumps", SPEED, seed, contact) for seed in o.seeds]
        events = float(np.mean([m.whole(p)["events"] for p in own]))
        rows.append((contact, f"{events / 1e6:.2f}", *(error(m, own, k) for k in OURS)))
    head = ("contact", "10⁶ events", *(NAMES[k] for k in OURS))
    note = (
        f"{CELLS} Against the skin as it is under that force: less force makes fewer events of "
        "less relief. The paper shows the same in pictures, without figures."
    )
    return Table("Contact force, bumps at 0.3 m/s, µm", head, rows, note)


def large(m: Measured, o: EvaluationOptions) -> Table:
    """Stitched plates."""
    rows = []
    for plate in o.large:
        mean, deviation = published.LARGE_UM[plate]
        own = _passes(o, plate, whole=True)
        rows.append(
            (plate, f"{mean:.1f} ± {deviation:.1f}", *(error(m, own, k) for k in OURS))
        )  # fmt: skip
        marks = m.whole(own[0])["methods"]["focus"]["objects"]
        for name in (n for n in marks if n.startswith(("scratch", "fault"))):
            cells = [_of_part(m, own, method, name) for method in OURS]
            rows.append((f"  {name}", "seen", *cells))
    head = ("plate", "the paper", *(NAMES[k] for k in OURS))
    note = f"{CELLS} Of defects of the letter plate, what lies within a rectangle around them."
    return Table("Large surfaces, stitched, at 0.3 m/s, µm", head, rows, note)


def sensors(m: Measured, o: EvaluationOptions) -> Table:
    """Sensors that roll."""
    rows = [
        (name, "–" if v is None else f"{1e3 * v:.0f}", "–" if e is None else f"{e:.1f}", "–")
        for name, v, e in published.SENSORS
    ]
    each = [_passes(o, name, FAST) for name in o.objects]
    for method in OURS:
        found = [m.mean(p, method, "mae_um") for p in each]
        seen = [m.mean(p, method, "edges_measured") for p in each]
        rows.append(
            (f"this workspace, {NAMES[method]} (virtual cell)", f"{1e3 * FAST:.0f}",
             _number(_mean(found)), _share(_mean(seen)))
        )  # fmt: skip
    note = (
        "Each on objects of its own. The others report no coverage. GelBelt's figure is of single "
        "defects against another tactile sensor, GelRoller's of single frames."
    )
    head = ("sensor", "fastest mm/s", "error µm", "edges")
    return Table("Sensors that roll", head, rows, note)


def error(m: Measured, own: Sequence[Pass], method: str) -> str:
    """Mean error and deviation over passes, with the coverage."""
    mean = m.mean(own, method, "mae_um")
    if mean is None:
        return "–"
    deviation = m.deviation(own, method, "mae_um")
    spread = f" ± {deviation:.1f}" if deviation is not None else ""
    return f"{mean:.1f}{spread} ({_share(m.mean(own, method, 'edges_measured'))})"


def mean_error(m: Measured, each: Sequence[Sequence[Pass]], method: str) -> str:
    """Mean over objects, each counting the same."""
    found = [m.mean(p, method, "mae_um") for p in each]
    spread = [m.deviation(p, method, "mae_um") for p in each]
    seen = [m.mean(p, method, "edges_measured") for p in each]
    about = f" ± {_mean(spread):.1f}" if _mean(spread) is not None else ""
    return f"{_number(_mean(found))}{about} ({_share(_mean(seen))})"


def _of_part(m: Measured, own: Sequence[Pass], method: str, name: str) -> str:
    parts = [m.whole(p)["methods"][method]["objects"][name] for p in own]
    found = _mean([part.get("mae_um") for part in parts])
    seen = _mean([part.get("edges_measured") for part in parts])
    return "–" if found is None else f"{found:.1f} ({_share(seen)})"


def _passes(
    o: EvaluationOptions, scene: str, speed_m_s: float = SPEED, whole: bool = False
) -> list[Pass]:
    return [Pass(scene, speed_m_s, seed, whole=whole) for seed in o.seeds]


def _mean(values: Sequence[float | None]) -> float | None:
    found = [v for v in values if v is not None]
    return float(np.mean(found)) if found else None


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.1f}"


def _share(value: float | None) -> str:
    return "–" if value is None else f"{value:.0%}"
