"""The report as PDF, where weasyprint is installed."""

from __future__ import annotations

import sys
from pathlib import Path

from roller_core.errors import RollerError


class PdfError(RollerError):
    """There is nothing that makes a PDF."""


def write_pdf(path: Path, html: str) -> None:
    """Write a page as PDF.

    Raises
    ------
    PdfError
        If weasyprint is not there or doesn't load.
    """
    check_pdf()
    import weasyprint

    weasyprint.HTML(string=html).write_pdf(str(path))


def check_pdf() -> None:
    """See that a PDF can be made; see `write_pdf`."""
    try:
        import weasyprint  # noqa: F401
    except (ImportError, OSError) as error:
        raise PdfError(
            f"a PDF needs weasyprint ({sys.executable} -m pip install weasyprint; apt-get install "
            f"libpango-1.0-0 libpangoft2-1.0-0): {error}".splitlines()[0]
        ) from error
