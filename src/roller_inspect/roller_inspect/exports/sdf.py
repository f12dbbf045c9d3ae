"""Height maps as SDF, the text format of ISO 25178-71."""

from __future__ import annotations

from datetime import datetime, timezone
from pathlib import Path

import numpy as np
import numpy.typing as npt

#: Heights are whole numbers of this, metres.
_STEP_M = 1e-9


def write_sdf(
    path: Path,
    x_m: npt.NDArray[np.float64],
    y_m: npt.NDArray[np.float64],
    height_m: npt.NDArray[np.float32],
) -> None:
    """Write a height map; parameters as of `write_x3p`."""
    now = f"{datetime.now(timezone.utc):%d%m%Y%H%M}"
    head = {
        "ManufacID": "roller",
        "CreateDate": now,
        "ModDate": now,
        "NumPoints": len(x_m),
        "NumProfiles": len(y_m),
        "Xscale": f"{float(np.diff(x_m).mean()) if len(x_m) > 1 else 1.0:.9e}",
        "Yscale": f"{float(np.diff(y_m).mean()) if len(y_m) > 1 else 1.0:.9e}",
        "Zscale": f"{_STEP_M:.9e}",
        "Zresolution": -1,
        "Compression": 0,
        "DataType": 6,  # 32-bit whole numbers
        "CheckType": 0,
    }
    with path.open("w", encoding="ascii") as file:
        file.write("aISO-1.0\n")
        file.writelines(f"{name:<12}= {value}\n" for name, value in head.items())
        file.write("*\n")
        for row in height_m.astype(np.float64) / _STEP_M:
            file.write(" ".join("BAD" if v != v else str(round(v)) for v in row.tolist()) + "\n")
        file.write("*\n")
