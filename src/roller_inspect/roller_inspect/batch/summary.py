"""The summary of a batch as table and page."""

from __future__ import annotations

import csv
import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, fields
from html import escape
from importlib import resources
from pathlib import Path

from roller_core.plain_json import to_text

from .jobs import Row

#: For bytes of file names that are no text.
_ODD = "backslashreplace"


def write_summary(folder: Path, rows: Sequence[Row], results: Path) -> None:
    """Write `summary.csv`, `summary.json` and `index.html`.

    Parameters
    ----------
    folder : path
        Where they go.
    rows : sequence of Row
        One a recording.
    results : path
        The folder with the results by key.
    """
    data = [asdict(row) for row in rows]
    counts = Counter(row.verdict or "failed" for row in rows)
    text = to_text({"schema": "roller-batch/1", "verdicts": counts, "jobs": data})
    (folder / "summary.json").write_text(text, encoding="utf-8")
    with (folder / "summary.csv").open("w", newline="", encoding="utf-8", errors=_ODD) as file:
        writer = csv.DictWriter(file, [field.name for field in fields(Row)])
        writer.writeheader()
        writer.writerows(data)
    (folder / "index.html").write_text(_page(rows, counts, results), encoding="utf-8", errors=_ODD)


def read_rows(folder: Path) -> dict[str, Row]:
    """Rows of a summary by key; none where there is none, or none that can be read."""
    try:
        jobs = json.loads((folder / "summary.json").read_text(encoding="utf-8"))["jobs"]
        return {job["key"]: Row(**job) for job in jobs}
    except (OSError, ValueError, KeyError, TypeError):
        return {}


#: Columns keep their words whole; only the reason breaks.
_STYLE = (
    "main { max-width: 1100px; } td img { width: 300px; display: block; } b.failed { color: "
    "#a31d16; } th, td { overflow-wrap: normal; padding-right: 14px; } "
    "td:nth-child(2) { overflow-wrap: anywhere; min-width: 14em; }"
)


def _page(rows: Sequence[Row], counts: Counter[str], results: Path) -> str:
    style = resources.files("roller_inspect.report").joinpath("style.css").read_text("utf-8")
    said = ", ".join(f"{n} {verdict}" for verdict, n in counts.most_common())
    body = "".join(_row(row, results) for row in rows)
    return (
        '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8"><title>Batch</title>'
        f"<style>{style}{_STYLE}</style></head>\n<body><main>"
        f"<h1>{len(rows)} recording{'s' if len(rows) != 1 else ''}: {escape(said)}</h1>\n"
        "<table><thead><tr><th>recording</th>"
        "<th>verdict</th><th>measured</th><th>findings</th><th>deepest µm</th><th>deviation</th>"
        f"</tr></thead><tbody>\n{body}</tbody></table></main></body></html>\n"
    )


def _row(row: Row, results: Path) -> str:
    name = escape(Path(row.source).name)
    if (results / row.key / "inspection.html").is_file() and row.verdict:
        name = f'<a href="{row.key}/inspection.html">{name}</a>'
    picture = ""
    if (results / row.key / "deviation.png").is_file() and row.verdict:
        picture = f'<img loading="lazy" alt="" src="{row.key}/deviation.png">'
    verdict = f'<b class="{row.verdict or "failed"}">{row.verdict or "failed"}</b>'
    depth = "–" if row.deepest_m is None else f"{row.deepest_m * 1e6:+.0f}"
    measured = "–" if row.measured is None else f"{row.measured:.1%}"
    cells = (
        name, f"{verdict}<br>{escape(row.error or row.reason)}", measured,
        "–" if row.findings is None else str(row.findings), depth, picture,
    )  # fmt: skip
    return "<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>\n"
