"""Whether a surface shows enough texture for what detection was shown for."""

from __future__ import annotations

from typing import Any

from roller_inspect.height_map.coverage import Coverage

#: Measured share of cells and events a mm² of the textured coating on which detection was shown,
#: and the depth that it finds: `roller evaluate pod`, seeds 1001 to 1007, all kinds. With less
#: contrast: 37 % and about 1,700 events found all from 70 µm on, 7 % and 500 missed half.
#: From the virtual cell, not fitted to a real roller.
SHOWN_MEASURED, SHOWN_EVENTS_PER_MM2, SHOWN_A90_95_UM = 0.45, 3800.0, 120
#: A scan with less proves nothing by finding nothing.
LEAST_MEASURED, LEAST_EVENTS_PER_MM2 = 0.3, 1000.0


def texture(coverage: Coverage, events: int | None) -> dict[str, Any]:
    """What a report says of a scan's texture.

    Parameters
    ----------
    coverage : Coverage
        Of the area to inspect.
    events : int or None
        Of the scan; None where it isn't known.
    """
    area_mm2 = coverage.area_m2 * 1e6
    per_mm2 = events / area_mm2 if events is not None and area_mm2 > 0 else None
    sufficient = coverage.measured >= LEAST_MEASURED and (
        per_mm2 is None or per_mm2 >= LEAST_EVENTS_PER_MM2
    )
    seen = f"{coverage.measured:.1%} of the cells measured"
    if per_mm2 is not None:
        seen += f", {per_mm2:.0f} events a mm²"
    text = (
        f"Texture suffices: {seen}."
        if sufficient
        else f"Too little texture: {seen}. Defects between what was measured are not seen; use a "
        "coating with a printed, high-contrast texture."
    )
    return {
        "measured": coverage.measured,
        "events_per_mm2": per_mm2,
        "sufficient": sufficient,
        "text": text,
        "shown_for": "Detection was shown on the virtual cell, not fitted to a real roller, with a "
        f"textured coating: {SHOWN_MEASURED:.0%} of the cells measured, "
        f"{SHOWN_EVENTS_PER_MM2:.0f} events a mm², at 0.3 m/s. There a defect "
        f"{SHOWN_A90_95_UM} µm deep was found with a probability of 90 % (a90/95). At least "
        f"{LEAST_MEASURED:.0%} and {LEAST_EVENTS_PER_MM2:.0f} events a mm² are asked for.",
    }
