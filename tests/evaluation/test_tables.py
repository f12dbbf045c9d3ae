"""Tables on the screen: on a narrow one nothing of a figure is lost."""

import pytest

from roller_evaluation.tables import Table, show_tables


@pytest.mark.parametrize("columns", [40, 80, 120, 200])
def test_no_figure_is_cut(
    columns: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("roller_evaluation.tables._WIDTH", columns)
    head = ("case", *(f"near edges {k} µm" for k in range(9)))
    rows = [("surface, 2 planes a pixel", *(f"{k}23.45 ± 6.7" for k in range(9)))]
    show_tables([Table("Cases", head, rows, "A note of some words.")])
    said = capsys.readouterr().out
    assert "…" not in said
    assert all(cell in said for cell in rows[0])
