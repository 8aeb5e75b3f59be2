"""Texts of users that a spreadsheet would run as formulas, or Markdown show as markup, in every table written."""

import csv
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import toy_problem
from verify_cases import fan

import verify
from topo_search.cli import main
from topo_search.export import audits as tables
from topo_search.export.audits import Judged, escape, markdown
from topo_search.model.files import to_json
from topo_search.model.text import escape_formula

FORMULAS = ["=1+1", "+cmd|' /C calc'!A0", "-2+3", "@SUM(A1)", "\t=1", '=HYPERLINK("http://x")']


@pytest.mark.parametrize("text", FORMULAS)
def test_a_text_is_no_formula(text: str) -> None:
    assert escape_formula(text) == f"'{text}"
    assert not escape(text).startswith(("=", "+", "-", "@"))


@pytest.mark.parametrize(
    "cell", [-1.5, 3, "-1.5", "+1e-3", "-inf", "", "a-b", "load case 0, torque", None, "clear"]
)
def test_numbers_and_plain_texts_stay_what_they_are(cell: object) -> None:
    assert escape_formula(cell) == cell


def test_tables_of_clearances_name_files_harmlessly() -> None:
    audit = verify.audit(fan())
    frame = tables.clearances_of([(name, audit) for name in FORMULAS])
    rows = list(csv.DictReader(tables.csv(frame).splitlines()))
    assert {row["design"] for row in rows} == {f"'{name}" for name in FORMULAS}
    assert [float(row["analytic_m"]) for row in rows] == frame["analytic_m"].tolist()
    numbers = pd.DataFrame({"x": [-1.5, np.nan], "n": pd.array([-1, None], dtype="Int64"), "t": ["-x", None]})
    assert tables.csv(numbers) == "x,n,t\n-1.5,-1,'-x\n,,\n"


def test_the_audit_command_names_files_harmlessly(in_process, tmp_path, monkeypatch) -> None:
    from click.testing import CliRunner

    monkeypatch.chdir(tmp_path)
    for name in ("=1+1.json", "@x.json"):
        (tmp_path / name).write_text(to_json(fan()))
    result = CliRunner().invoke(main, ["audit", "=1+1.json", "@x.json", "--csv", "t.csv", "--markdown", "t.md"])
    assert result.exit_code == 0
    table = list(csv.DictReader((tmp_path / "t.csv").read_text().splitlines()))
    assert {row["design"] for row in table} == {"'=1+1.json", "'@x.json"}
    cells = [cell.strip() for line in (tmp_path / "t.md").read_text().splitlines() for cell in line.split("|")]
    assert r"\=1+1.json" in cells
    assert not [cell for cell in cells if cell.startswith(("=", "+", "@"))]


def test_the_table_of_candidates_has_no_formulas(tmp_path, monkeypatch) -> None:
    from topo_search.study import ledger
    from topo_search.study.ledger import COLUMNS

    ranked = ledger.Ledger.ranking

    def hostile(self, n):
        return [replace(row, worst_constraint="=1+1", unit="@x") for row in ranked(self, n)]

    monkeypatch.setattr(ledger.Ledger, "ranking", hostile)
    toy_problem.toy_run(tmp_path / "run", modules=2)
    rows = list(csv.DictReader((tmp_path / "run" / "candidates.csv").read_text().splitlines()))
    assert tuple(rows[0]) == COLUMNS
    assert {(row["worst_constraint"], row["unit"]) for row in rows} == {("'=1+1", "'@x")}


def test_markdown_lists_and_headings_are_text() -> None:
    assert [escape(text) for text in ("# a", "1. a", "1.json", "- a")] == [r"\# a", r"1\. a", "1.json", r"\- a"]
    summary = markdown([Judged("=1", fan(), verify.audit(fan()))], [("# x", "- y")])
    assert r"- \# x: \- y" in summary
