"""The paper's tables beside ours, from rows."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from . import paper_values as paper
from .experiments import (
    CONTACTS,
    FAST,
    FUSIONS,
    OURS,
    SPEED,
    EvaluationOptions,
    object_speeds,
)
from .map_errors import map_table
from .rows import Row, deviation, mean, mean_of, values, where
from .tables import Table, number, share
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
LIGHT_NOTE = (
    "Lights: a ring that travels with the camera; a diffuse dome, in which a place's brightness "
    "does not depend on where it is in the image; strong, a brighter ring seen by another sensor "
    "(threshold 0.25, 4 kHz, 0.5 ms of refractory time). The ring is the one that the methods' "
    "constants were tuned in."
)


def tables(rows: Sequence[Row], options: EvaluationOptions) -> dict[str, Table]:
    """Tables by experiment, of those that were asked for."""
    makers: dict[str, Callable[[Sequence[Row], EvaluationOptions], Table]] = {
        "weights": weights, "fusion": fusion, "objects": objects, "speed": speed, "views": views,
        "lines": lines, "force": force, "large": large, "sensors": sensors, "map": height_maps,
    }  # fmt: skip
    return {name: make(rows, options) for name, make in makers.items() if name in options.only}


def of_object(
    rows: Iterable[Row], scene: str, method: str, speed: float = SPEED, contact: str = "full",
    light: str = "ring",
) -> list[Row]:  # fmt: skip
    """A method's rows over the passes of one object."""
    return where(
        rows, measure="depth", scene=scene, method=method, speed=speed, contact=contact, light=light
    )


def weights(rows: Sequence[Row], o: EvaluationOptions) -> Table:
    """The best weights of each object, tried on all (the paper's cross-validation)."""
    names = o.calibration_set
    cells = [
        (f"{name}, the paper", *(f"{w:.3f}" for w in values), f"{mean_um:.1f}",
         *("–" for _ in names))
        for name, (values, mean_um) in paper.WEIGHTS.items()
        if name in names
    ]  # fmt: skip
    for name, best, um, seen in cross_validated(where(rows, measure="weights"), names):
        each = [f"{e:.1f} ({v:.1%})" for e, v in zip(um, seen, strict=True)]
        over_all = f"{um.mean():.1f} ({seen.mean():.1%})"
        cells.append((name, *(f"{w:.3f}" for w in best), over_all, *each))
    for method in ("focus", "surface"):
        own = [of_object(rows, name, method) for name in names]
        cells.append(
            (f"{NAMES[method]}, without", "–", "–", "–", mean_error(own), *map(error, own))
        )
    note = (
        f"Of {len(weight_choices())} weights on the simplex those with the least mean absolute "
        "error, µm, over an object's passes, and their error over each object, with the share of "
        "its pixels in contact that have a depth (of focus and surface: of relief edges); they "
        "must measure at least 95 % of what any weights do. The paper finds most weight at the "
        "start in all three; the virtual cell has none of the reasons that it gives for that."
    )
    head = ("found on", "start", "middle", "end", "mean", *names)
    return Table("Weights of bma by object, 0.3 m/s", head, cells, note)


def fusion(rows: Sequence[Row], o: EvaluationOptions) -> Table:
    """EMVS, left & right and BMA on the calibration set (the paper's first table of errors)."""
    names = o.calibration_set
    cells = [
        (f"{NAMES[k]}, the paper", *(f"{v[n]:.1f}" for n in names),
         f"{np.mean([v[n] for n in names]):.1f}")
        for k, v in paper.FUSION_UM.items()
    ]  # fmt: skip
    found = {m: [of_object(rows, name, m) for name in names] for m in FUSIONS}
    cells += [(NAMES[m], *map(error, own), mean_error(own)) for m, own in found.items()]
    emvs, bma = ([mean_of(mean(r, c) for r in found[m]) for c in ("mae_um", "edges_measured")]
                 for m in ("emvs", "bma"))  # fmt: skip
    change = f"{bma[0] / emvs[0] - 1:+.0%}" if emvs[0] and bma[0] else "–"
    note = (
        f"{CELLS} Fusing three views changes the error of EMVS by {change} here and the edges "
        f"measured from {share(emvs[1])} to {share(bma[1])}; in the paper it lowers the error by "
        f"25 %. The views share a window's events, so their errors go together and fusing fills "
        f"gaps. {MEDIAN}"
    )
    return Table("Depth methods at 0.3 m/s, µm", ("method", *names, "mean"), cells, note)


def objects(rows: Sequence[Row], o: EvaluationOptions, speed_m_s: float = SPEED) -> Table:
    """All objects in all lights, mean and deviation over passes."""
    if len(o.objects) == len(paper.OBJECTS_UM):
        all_um, all_about = paper.OVERALL_UM
    else:
        all_um, all_about = np.mean([paper.OBJECTS_UM[name] for name in o.objects], axis=0)
    published = {**paper.OBJECTS_UM, "all": (all_um, all_about)}
    cells = []
    for light in o.lights:
        found = [[of_object(rows, n, m, speed_m_s, light=light) for m in OURS] for n in o.objects]
        texts = {name: list(map(error, own)) for name, own in zip(o.objects, found, strict=True)}
        texts["all"] = [mean_error(each) for each in zip(*found, strict=True)]
        for name, own in texts.items():
            if light == "ring":
                values, about = published[name]
                cells.append((name, f"{values:.1f} ± {about:.1f}", *own))
            else:
                cells.append((f"{name}, {light}", "–", *own))
    head = ("object", f"the paper (BMA, {SPEED:g} m/s)", *(NAMES[k] for k in OURS))
    note = f"{CELLS} {MEDIAN} The paper's masks are drawn by hand; here all of the skin is known."
    return Table(f"The six objects at {speed_m_s:g} m/s, µm", head, cells, f"{note} {LIGHT_NOTE}")


def by_light(rows: Sequence[Row], o: EvaluationOptions) -> Table:
    """Means over the objects by method, light and speed."""
    cells = []
    for method in OURS:
        for light in o.lights:
            texts = []
            for speed_m_s in object_speeds(o):
                each = [of_object(rows, n, method, speed_m_s, light=light) for n in o.objects]
                near, every, middle, seen = (
                    mean_of(mean(own, column) for own in each)
                    for column in ("near_edge_mae_um", "mae_um", "median_um", "edges_measured")
                )
                texts += [f"{number(near)} ({share(seen)})", f"{number(every)}; {number(middle)}"]
            cells.append((f"{NAMES[method]}, {light}", *texts))
    head = ["method, light"]
    for speed_m_s in object_speeds(o):
        head += [f"{speed_m_s:g} m/s, near edges", "all; median"]
    note = (
        "Means over the objects, µm: the mean error near relief edges (with the share of edges "
        f"measured), that of all points, and their median error. {LIGHT_NOTE} What holds in one "
        "light alone is fitted to it."
    )
    return Table("Error by light, µm", tuple(head), cells, note)


def speed(rows: Sequence[Row], o: EvaluationOptions) -> Table:
    """Errors on the sphere by speed, and what BMA gains on EMVS."""
    cells = []
    for v in o.speeds:
        found = {m: of_object(rows, "sphere", m, v) for m in FUSIONS}
        emvs, bma = (mean(found[k], "mae_um") for k in ("emvs", "bma"))
        gain = f"{1 - bma / emvs:.1%}" if emvs and bma else "–"
        published = paper.REDUCTION.get(v)
        cells.append(
            (f"{v:g}", *map(error, found.values()), gain, f"{published:.1%}" if published else "–")
        )
    head = ("m/s", *(NAMES[k] for k in FUSIONS), "BMA against EMVS", "the paper")
    note = (
        f"{CELLS} Windows of 20 ms hold 1 mm of travel at 0.05 m/s and 10 mm at 0.5: the paper's "
        "methods gain with speed as their parallax does. Windows by travel don't need it; at speed "
        "they lose what pixels miss while they wait for their read-out."
    )
    return Table("The sphere by speed, µm", head, cells, note)


def views(rows: Sequence[Row], o: EvaluationOptions) -> Table:
    """Three against five reference views."""
    cells = [
        (
            {"bma": "three", "bma_5": "five"}[name],
            f"{values:.1f} ± {about:.1f}",
            error(of_object(rows, "sphere", name)),
        )
        for name, (values, about) in paper.VIEWS_UM.items()
    ]
    for name in ("focus", "surface"):
        cells.append((f"one: {NAMES[name]}", "–", error(of_object(rows, "sphere", name))))
    note = f"{CELLS} Weights of five views are equal; the paper doesn't give its own."
    head = ("reference views", "the paper", "here")
    return Table("Reference views, sphere at 0.3 m/s, µm", head, cells, note)


def lines(rows: Sequence[Row], o: EvaluationOptions) -> Table:
    """Deviation of the height of three equal lines."""
    cells = []
    for method in FUSIONS:
        own = where(rows, measure="plate", scene="three_lines", method=method)
        plate = where(own, object="plate")
        published, spread = paper.LINES_UM.get(method), mean(plate, "spread_um")
        tops = [
            values([r for r in where(own, seed=seed) if r["object"] != "plate"], "top_um")
            for seed in o.seeds
        ]
        apart = mean_of(float(np.ptp(each)) if len(each) > 1 else None for each in tops)
        covered = share(mean(plate, "tops_measured"))
        cells.append(
            (
                NAMES[method],
                number(published, 0),
                f"{spread:.1f} ({covered})" if spread is not None else "–",
                number(apart),
                error(plate),
            )
        )
    head = ("method", "the paper", "deviation on top", "lines apart", "whole plate")
    note = (
        f"{CELLS} Deviation of the heights found on top of all lines, more than 0.2 mm from their "
        "walls, with the share of that area (cells of 0.1 mm) that holds a point, and how far the "
        "lines' means are apart. The tops are smooth: only the coating's speckle shows there."
    )
    return Table("Three equal lines of 0.6 mm at 0.3 m/s, µm", head, cells, note)


def force(rows: Sequence[Row], o: EvaluationOptions) -> Table:
    """The bumps under three contact forces."""
    cells = []
    for contact in CONTACTS:
        found = [of_object(rows, "bumps", m, contact=contact) for m in OURS]
        # All events of the pass, which `surface` takes.
        events = mean(found[OURS.index("surface")], "events")
        millions = number(None if events is None else events * 1e-6, 2)
        cells.append((contact, millions, *map(error, found)))
    head = ("contact", "10⁶ events", *(NAMES[k] for k in OURS))
    note = (
        f"{CELLS} Against the skin as it is under that force: less force makes fewer events of "
        "less relief. The paper shows the same in pictures, without figures."
    )
    return Table("Contact force, bumps at 0.3 m/s, µm", head, cells, note)


def large(rows: Sequence[Row], o: EvaluationOptions) -> Table:
    """Stitched plates."""
    cells = []
    for plate in o.large:
        own = where(rows, measure="plate", scene=plate)
        values_um, about = paper.LARGE_UM[plate]
        found = [where(own, object="plate", method=m) for m in OURS]
        cells.append((plate, f"{values_um:.1f} ± {about:.1f}", *map(error, found)))
        names = dict.fromkeys(r["object"] for r in own)
        for name in (n for n in names if n.startswith(("scratch", "fault"))):
            parts = [where(own, object=name, method=m) for m in OURS]
            texts = [
                "–" if (e := mean(p, "mae_um")) is None
                else f"{e:.1f} ({share(mean(p, 'edges_measured'))})"
                for p in parts
            ]  # fmt: skip
            cells.append((f"  {name}", "seen", *texts))
    head = ("plate", "the paper", *(NAMES[k] for k in OURS))
    note = f"{CELLS} Of defects of the letter plate, what lies within a rectangle around them."
    return Table("Large surfaces, stitched, at 0.3 m/s, µm", head, cells, note)


def height_maps(rows: Sequence[Row], o: EvaluationOptions) -> Table:
    """The inspection's map of each object, in all lights."""
    return map_table(rows, o.objects, o.lights, SPEED)


def sensors(rows: Sequence[Row], o: EvaluationOptions) -> Table:
    """Sensors that roll."""
    cells = [
        (name, number(None if v is None else 1e3 * v, 0), number(e), "–")
        for name, v, e in paper.SENSORS
    ]
    for method in OURS:
        each = [of_object(rows, name, method, FAST) for name in o.objects]
        cells.append(
            (f"this workspace, {NAMES[method]} (virtual cell)", f"{1e3 * FAST:.0f}",
             number(mean_of(mean(own, "mae_um") for own in each)),
             share(mean_of(mean(own, "edges_measured") for own in each)))
        )  # fmt: skip
    note = (
        "Each on objects of its own. The others report no coverage. GelBelt's figure is of single "
        "defects against another tactile sensor, GelRoller's of single frames."
    )
    head = ("sensor", "fastest mm/s", "error µm", "edges")
    return Table("Sensors that roll", head, cells, note)


def error(rows: Sequence[Row]) -> str:
    """Mean error and deviation over passes, with the coverage."""
    found, about = mean(rows, "mae_um"), deviation(rows, "mae_um")
    if found is None:
        return "–"
    spread = f" ± {about:.1f}" if about is not None else ""
    return f"{found:.1f}{spread} ({share(mean(rows, 'edges_measured'))})"


def mean_error(each: Sequence[Sequence[Row]]) -> str:
    """Mean over objects, each counting the same."""
    found, spread = (mean_of(of(r, "mae_um") for r in each) for of in (mean, deviation))
    about = f" ± {spread:.1f}" if spread is not None else ""
    return f"{number(found)}{about} ({share(mean_of(mean(r, 'edges_measured') for r in each))})"
