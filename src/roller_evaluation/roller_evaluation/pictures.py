"""Pictures in files and in memory."""

from __future__ import annotations

import io
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.figure import Figure


def write_picture(figure: Figure, path: Path) -> None:
    """Write a picture as PNG and close it."""
    path.write_bytes(png(figure))


def png(figure: Figure) -> bytes:
    """A picture as PNG; it is closed."""
    out = io.BytesIO()
    try:
        figure.savefig(out, format="png", metadata={"Software": None})
    finally:
        plt.close(figure)
    return out.getvalue()
