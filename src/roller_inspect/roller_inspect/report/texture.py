"""Whether a surface shows enough texture for what detection was shown for."""

from __future__ import annotations

from typing import Any

from roller_inspect.height_map.coverage import LEAST_TEXTURE, Coverage, textured

#: Measured share of cells and events a mm² of the textured coating on which detection was shown,
#: and the depth that it finds: `roller evaluate pod`, seeds 1001 to 1007, all kinds.
#: From the virtual cell, not fitted to a real roller.
SHOWN_MEASURED, SHOWN_EVENTS_PER_MM2, SHOWN_A90_95_UM = 0.52, 7000.0, 93
#: Share of the cells that many events leave unmeasured only where depths are uncertain.
_HARDLY = 0.02
#: Fewest events a mm².
LEAST_EVENTS_PER_MM2 = 500.0


def texture(
    coverage: Coverage,
    grid_m: float,
    events: int | None,
    scanned_m2: float,
    faulty: bool = False,
) -> dict[str, Any]:
    """What a report says of a scan's texture.

    Parameters
    ----------
    coverage : Coverage
        Of the area to inspect.
    grid_m : float
        Edge of a cell.
    events : int or None
        Of the scan; None where it isn't known.
    scanned_m2 : float
        Area of the scan.
    faulty : bool
        Whether it had faults, which may have ended it.
    """
    # Of a scan that a fault ended, events are of more than was measured.
    known = events is not None and scanned_m2 > 0 and not faulty
    per_mm2 = events / scanned_m2 * 1e-6 if events is not None and known else None
    measured = coverage.texture
    sufficient = textured(coverage, grid_m) and (per_mm2 is None or per_mm2 >= LEAST_EVENTS_PER_MM2)
    seen = f"{measured:.1%} of the cells measured"
    if per_mm2 is not None:
        seen += f", {per_mm2:.0f} events a mm²"
    text = (
        f"Texture suffices: {seen}."
        if sufficient
        else "A fault ended the scan before anything was measured: of its texture nothing is known."
        if faulty and not measured
        else f"The scan had faults: {seen}. Whether its texture suffices isn't known."
        if faulty
        else "The scan didn't reach what is to be inspected: are the recipe's frame and regions "
        "those of this part?"
        if not coverage.scanned
        else f"Too little is sure: {seen}. There are events enough, so depths are too uncertain: "
        "inspect with surface or focus, and see that contact and poses were good."
        if per_mm2 is not None and per_mm2 >= SHOWN_EVENTS_PER_MM2 and measured < _HARDLY
        else f"Too little texture: {seen}. Defects between what was measured are not seen; use a "
        "coating with a printed, high-contrast texture."
    )
    return {
        "measured": measured,
        "events_per_mm2": per_mm2,
        "sufficient": sufficient,
        "text": text,
        "shown_for": "Detection was shown on the virtual cell, not fitted to a real roller, with a "
        f"textured coating: {SHOWN_MEASURED:.0%} of the cells measured, "
        f"{SHOWN_EVENTS_PER_MM2:.0f} events a mm², at 0.3 m/s. There a defect "
        f"{SHOWN_A90_95_UM} µm deep was found with a probability of 90 % (a90/95). At least "
        f"{LEAST_TEXTURE:.0%} and {LEAST_EVENTS_PER_MM2:.0f} events a mm² are asked for.",
    }
