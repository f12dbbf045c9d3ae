"""The report as PDF: the page itself where weasyprint is installed, else its figures and text."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable
from importlib import resources
from pathlib import Path

import numpy as np
import numpy.typing as npt

#: A sheet of A4, inches; characters of a line and lines of a sheet.
_A4 = (8.27, 11.69)
_COLUMNS, _ROWS = 96, 78


def write_pdf(
    path: Path, html: str, lines: Iterable[str], picture: npt.NDArray[np.uint8] | None = None
) -> None:
    """Write the report as PDF.

    Parameters
    ----------
    path : path
        The file.
    html : str
        The page.
    lines : iterable of str
        What it says as text, the verdict first, for machines without weasyprint.
    picture : (n, m, 3) uint8, optional
        The map, RGB, for the same.
    """
    try:
        import weasyprint
    except (ImportError, OSError):  # it needs libraries of the system, too
        _write_text(path, lines, picture)
        return
    weasyprint.HTML(string=_with_styled_charts(html)).write_pdf(str(path))


def _with_styled_charts(html: str) -> str:
    """The page with the charts' style in each of them: weasyprint knows no other for SVG.

    They take the width that there is: of those with a size of their own only the width shrinks.
    """
    charts = resources.files("roller_inspect.report").joinpath("charts.css").read_text("utf-8")
    # Nor does it draw a text's stroke below its fill.
    style = f"<style>{charts}.tag {{ stroke: none; }}</style>"
    return re.sub(r'<svg (viewBox="[^"]*")[^>]*>', rf'<svg \1 style="width: 100%">{style}', html)


def _write_text(
    path: Path, lines: Iterable[str], picture: npt.NDArray[np.uint8] | None = None
) -> None:
    from matplotlib import rc_context
    from matplotlib.backends.backend_pdf import PdfPages
    from matplotlib.figure import Figure

    rows = [row for line in lines for row in textwrap.wrap(line, _COLUMNS) or [""]]
    if picture is not None:  # the first sheet has it below the verdict
        rows[_ROWS // 2 : _ROWS // 2] = [""] * (_ROWS // 2) if len(rows) > _ROWS // 2 else []
    with rc_context({"pdf.fonttype": 42}), PdfPages(path) as pdf:
        for n in range(0, len(rows), _ROWS):
            sheet = Figure(figsize=_A4)
            text = "\n".join(rows[n : n + _ROWS])
            sheet.text(0.06, 0.96, text, size=8, family="monospace", va="top", parse_math=False)
            if picture is not None and n == 0:
                axes = sheet.add_axes((0.06, 0.05, 0.88, 0.42))
                axes.imshow(picture)
                axes.set_axis_off()
            pdf.savefig(sheet)
