"""From a compared map to findings."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from roller_inspect.height_map.height_map import Bools, HeightMap
from roller_inspect.references.reference import Comparison, Reference

from .components import Component, components
from .cues import height_cue
from .finder_settings import FindingSettings
from .finding import Finding
from .flanks import joined
from .floors import with_floors
from .sizes import measure

#: A rise that lies in a crater's outline by more than this share is the crater's edge.
_RIM_SHARE = 0.5
#: What is less than about its own uncertainty, and lies this near, m, to what is at least so many
#: times as deep the other way, is the edge of that: the skin bridges walls, and their lines are the
#: least sure. Chosen on the plates for tuning: none of the defects there goes with them.
_EDGE_DEPTH, _EDGE_M, _EDGE_SURE = 1.0, 3e-4, 1.1


@dataclass(frozen=True)
class Search:
    """What was found on a map."""

    #: The map against its reference, findings left out of the fit.
    comparison: Comparison
    #: Numbered from 1.
    findings: tuple[Finding, ...]
    #: First column of each finding, and the first behind it.
    spans: tuple[tuple[int, int], ...]
    #: All that may be a finding. Shape (ny, nx).
    mask: Bools


def search(
    height_map: HeightMap,
    reference: Reference,
    settings: FindingSettings,
    known: Iterable[tuple[int, int, float]] = (),
    masked: Bools | None = None,
    figures: bool = True,
) -> Search:
    """Compare a map with a reference and find where it differs.

    Parameters
    ----------
    height_map : HeightMap
        The map.
    reference : Reference
        What it is compared with.
    settings : FindingSettings
        What counts as a finding.
    known : iterable of (int, int, float)
        Row, column and depth of findings that need not be measured again.
    masked : ndarray of bool, shape (ny, nx), optional
        What an earlier search found: it stays out of the reference's fit.
    figures : bool
        Whether to measure what is found; else there are no findings, only where they may be.

    Raises
    ------
    ReferenceError
        If the reference doesn't fit the map.
    """
    # The background is what lies around already.
    local = reference.name != "self"
    comparison = reference.compare(height_map, masked)
    cues = height_cue(height_map, comparison, settings, local)
    cues = with_floors(cues, height_map.step_m, settings)
    parts = joined(components(cues), cues, height_map.step_m)
    found: list[tuple[Finding, Component]] = []
    craters: list[Component] = []
    depths: list[tuple[float, Component]] = []
    known = list(known)
    # Hollows first: what rises around a crater is part of it.
    for part in sorted(parts if figures else (), key=lambda part: part.sign):
        before = [depth for *cell, depth in known if part.holds(*cell) and part.sign * depth > 0]
        if before:
            depths.append((before[0], part))
            continue
        if part.sign > 0 and any(part.share_in(crater) > _RIM_SHARE for crater in craters):
            continue
        measured = measure(part, height_map, comparison, cues, settings, reference.models_part)
        if measured is not None:
            found.append((measured[0], part))
            depths.append((measured[0].depth_m, part))
            if measured[0].kind == "crater":
                craters.append(measured[1])
    reach = round(_EDGE_M / height_map.step_m)
    found = [f for f in found if not _is_edge(*f, depths, reach)]
    found.sort(key=lambda f: (f[1].columns.start, f[1].rows.start, f[1].sign))
    return Search(
        comparison,
        tuple(replace(f, id=i) for i, (f, _) in enumerate(found, 1)),
        tuple((part.columns.start, part.columns.stop) for _, part in found),
        _mask(parts, height_map.shape),
    )


def _is_edge(
    finding: Finding, part: Component, depths: list[tuple[float, Component]], reach: int
) -> bool:
    """Whether a finding is the edge of one that is deeper, the other way."""
    own = abs(finding.depth_m)
    if own >= _EDGE_SURE * finding.uncertainty.depth_m:
        return False
    around = part.grown(reach)
    return any(
        other.sign != part.sign and abs(depth) >= _EDGE_DEPTH * own and other.share_in(around) > 0
        for depth, other in depths
    )


def _mask(parts: list[Component], shape: tuple[int, int]) -> Bools:
    mask = np.zeros(shape, bool)
    for part in parts:
        mask[part.rows, part.columns] |= part.mask
    return mask
