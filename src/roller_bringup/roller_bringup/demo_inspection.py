"""The part of the demonstration that is inspected: its recipe, its findings against the truth."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import yaml
from rosbags.rosbag2 import Reader

from roller_core import outputs
from roller_core.bags import typestore
from roller_core.outputs import Output, ScanFault, cloud_of, stamp_ns
from roller_evaluation.detection import matched
from roller_inspect.inspect_stage import InspectStage, inspect_parameters
from roller_inspect.judgement import Inspected, longest_part
from roller_inspect.recipe import Recipe, load_recipe
from roller_inspect.report.document import Scan, inspection_document
from roller_inspect.results.inspection_files import write_inspection
from roller_inspect.results.run_report import Report
from roller_sim.relief import Region
from roller_sim.truth import Truth
from roller_sim.truth_files import truth_beside


def inspect_recorded(bag: Path, recipe: Recipe, part: str, params: Path | None = None) -> Inspected:
    """Inspect the surface that a recorded graph published, as its node `inspect` did.

    Parameters
    ----------
    bag : path
        rosbag2 with `/roller/surface/points`.
    recipe : Recipe
        What the node had.
    part : str
        Name of the part.
    params : path, optional
        The node's parameter file, where it was given any.

    Raises
    ------
    RollerError
        If the points are none of ours.
    """
    stage = InspectStage(inspect_parameters(params, part=part), recipe)
    wanted = set(map(outputs.bag_topic, (outputs.SURFACE_POINTS, outputs.CONTACT)))
    store, found = typestore(), []
    with Reader(bag) as reader:
        connections = [c for c in reader.connections if c.topic in wanted]
        for connection, _, data in reader.messages(connections):
            message: Any = store.deserialize_cdr(data, connection.msgtype)
            t_ns, frame = stamp_ns(message), message.header.frame_id
            topic = connection.topic[1:]
            if topic == outputs.SURFACE_POINTS:
                stage.take_output(Output(topic, t_ns, frame, cloud_of(message)))
            else:
                for status in message.status:
                    stage.take_output(Output(topic, t_ns, frame, ScanFault(status.message)))
            found += [result.found for result in stage.results()]
        found += [result.found for result in stage.results(flush=True)]
    return longest_part((p for p in found if isinstance(p, Inspected)), recipe, part)


#: Region of scenes that is inspected, and how deep a defect it may have, m.
FACE, MOST_DEPTH_M = "face", 1e-4


def write_recipe(face: Region, path: Path) -> None:
    """Write the recipe for a plain face between relief: it alone, up to its border."""
    box = [float(v) for v in (face.x0, face.y0, face.x1, face.y1)]
    recipe = {
        "schema": "roller-recipe/1",
        "name": "demonstration",
        "regions": {FACE: {"box_m": box}},
        "inspect": [FACE],
        "tolerances": [{"region": FACE, "depth_m": MOST_DEPTH_M}],
    }
    path.write_text(yaml.safe_dump(recipe, sort_keys=False))


def inspect_part(
    folder: Path, recipe_file: Path, calibration: Path, report: Report, events: int
) -> list[str]:
    """Write the inspection of a recorded run, and hold its findings to the truth.

    Parameters
    ----------
    folder : path
        With `bag/` and `truth/`; the files of the inspection go here.
    recipe_file, calibration : path
        What node `inspect` had.
    report : Report
        Of the run.
    events : int
        Of the scan.

    Returns
    -------
    list of str
        The verdict, and a table of the defects and what was found of them.
    """
    recipe, truth = load_recipe(recipe_file), truth_beside(folder / "truth")
    inspected = inspect_recorded(folder / "bag", recipe, "demonstration", calibration)
    camera = None if truth is None else truth.camera
    scan = Scan(folder / "bag", calibration, camera, report.method, report.settings, events)
    document = inspection_document(inspected, recipe, scan)
    write_inspection(folder, document, inspected.found, recipe.depth_tolerance_m)
    cover = inspected.judgement.coverage
    lines = [
        f"the part's face: {document['verdict'].upper()}: {document['reason']}; "
        f"measured {cover.measured:.0%}, continued {cover.continued:.0%}"
    ]
    return lines if truth is None else [*lines, *defect_table(inspected, truth)]


def defect_table(inspected: Inspected, truth: Truth) -> list[str]:
    """Each defect beside what was found of it, and what was found where there is none."""
    origin = truth.origin_m[:2]
    findings = [judged.finding for judged in inspected.judgement.findings]
    verdicts = {judged.finding.id: judged.verdict for judged in inspected.judgement.findings}
    hits, others = matched(findings, [np.asarray(m.outline) + origin for m in truth.defects])
    head = f"{'defect':10s} {'true µm':>8s} {'found µm':>12s} {'found as':>9s}  verdict"
    rows = [head, "-" * len(head)]
    for k, mark in enumerate(truth.defects):
        true = f"{mark.depth * 1e6:+8.0f}"
        found = hits.get(k)
        if found is None:
            rows.append(f"{mark.name:10s} {true} {'not found':>12s}")
            continue
        u = found.uncertainty.depth_m
        depth = f"{found.depth_m * 1e6:+.0f}" + (f" ± {u * 1e6:.0f}" if u is not None else "")
        rows.append(f"{mark.name:10s} {true} {depth:>12s} {found.kind:>9s}  {verdicts[found.id]}")
    rows.append(f"found where there is none: {len(others)}")
    return rows
