"""The results that are kept beside the notebooks: whole, and described by what they hold."""

import json
import re
import shutil
from importlib import metadata
from pathlib import Path

import documented
import pandas as pd
import pytest
from benchmarks import keep_results

from topo_search.cli.experiment import NAMES
from topo_search.compose import BACKENDS
from topo_search.experiments import Settings, experiment, results
from topo_search.experiments.paper import FULLY, REACHED
from topo_search.experiments.study import COLUMNS, IDENTITY, METHOD, identity, measure
from topo_search.model.proven import SOLVER_PRECISION, gap_percent

FOLDER = Path(__file__).parents[1] / "notebooks" / "results"
TEXT = " ".join((FOLDER / "README.md").read_text(encoding="utf-8").replace("\n- ", " ").split())


def test_every_file_has_its_description():
    tables, descriptions = ({path.stem for path in FOLDER.glob(kind)} for kind in ("*.csv", "*.json"))
    tables -= {"flights"}  # its rows say their commands
    descriptions -= {"gallery", *(path.stem for path in FOLDER.glob("flight-*.json"))}  # these have no table
    assert tables == descriptions
    assert set(NAMES) <= tables


@pytest.mark.parametrize(
    "path", sorted(set(FOLDER.glob("*.csv")) - {FOLDER / "flights.csv"}), ids=lambda path: path.stem
)
def test_rows_are_those_of_the_command(path):
    about = json.loads(path.with_suffix(".json").read_text())
    asked, settings, rows = (
        experiment(about["experiment"]),
        keep_results.settings_of(about["settings"]),
        results(path),
    )
    if set(rows["method"]) == {METHOD}:
        assert about["command"] == f"topo-search experiment {asked.name} {settings.as_options()}"
    else:
        assert about["command"].startswith("python tests/benchmarks/direct_scaling.py --tasks ")
    assert {"date", "versions"} <= set(about)
    assert list(rows.columns) == list(COLUMNS)
    planned = {identity(cell.row) for cell in asked.cells(settings)}
    known = rows[list(IDENTITY)].astype(object).where(rows[list(IDENTITY)].notna(), None)
    found = {identity(row) for row in known.to_dict("records")}
    assert found <= planned
    assert len(found) == len(rows)
    assert about["command"] in TEXT
    assert f"{path.stem}.csv, {len(rows)} of {len(planned)} problems, {keep_results.dated(about)}" in re.sub(
        r"[`*]", "", TEXT
    )


SHOWN = {
    "scaling": ("docs/pages/tutorials/notebooks.md", "notebooks/3_scaling.ipynb"),
    "scaling-direct": ("docs/pages/tutorials/notebooks.md", "notebooks/3_scaling.ipynb"),
    "ablation": ("docs/pages/how-to/experiments.md", "notebooks/4_ablation.ipynb"),
    **dict.fromkeys(("placement", "root", "body"), ("notebooks/7_what_choices_cost.ipynb",)),
    **dict.fromkeys(("hinges", "hinges-large"), ()),
}
"""Pages that show figures of a table, beside the README of its folder."""


@pytest.mark.parametrize("name", SHOWN)
def test_rows_are_those_of_today_or_dated_wherever_they_are_shown(name):
    """The row that takes the least time is measured again, unless another version or a benchmark made the table."""
    about = json.loads((FOLDER / f"{name}.json").read_text())
    assert f"{name}.csv`, " in TEXT
    made_by = keep_results.dated(about)
    assert re.search(rf"{name}\.csv`, [0-9]+ of [0-9]+ problems, {re.escape(made_by)}, of", TEXT)
    if about["versions"]["topo-search"] != metadata.version("topo-search"):
        by_version = made_by.partition(" on ")[0]
        assert all(by_version in (documented.ROOT / page).read_text().lower() for page in SHOWN[name])
        return
    study, settings = experiment(about["experiment"]), keep_results.settings_of(about["settings"])
    rows = results(FOLDER / f"{name}.csv")
    if set(rows["method"]) != {METHOD}:  # a benchmark made these, which neither search nor audit
        return
    row = rows.loc[rows["solve_s"].where(rows["status"] == "feasible").idxmin()]
    (cell,) = (
        c for c in study.cells(settings) if (c.variant.name, c.task, c.key) == (row.variant, row.task, row.key)
    )
    today = measure(BACKENDS, settings, study.first, cell)
    assert (today["status"], today["verdict"]) == (row.status, row.verdict)
    assert today["objective"] == pytest.approx(row.objective, rel=SOLVER_PRECISION)


def test_a_run_is_kept_and_the_text_is_the_one_that_belongs_to_the_rows(tmp_path, monkeypatch):
    kept, run = tmp_path / "results", tmp_path / "run"
    shutil.copytree(FOLDER, kept)
    run.mkdir()
    (tmp_path / "pictures").mkdir()
    (kept / "root.json").rename(run / "about.json")
    rows = (kept / "root.csv").read_bytes()
    (kept / "root.csv").unlink()
    (run / "results.csv").write_bytes(rows + b"paper root,push,0.15,4,a30")
    (kept / "README.md").unlink()
    monkeypatch.setattr(keep_results, "RESULTS", kept)
    monkeypatch.setattr("sys.argv", ["keep_results.py", f"root={run}"])
    keep_results.main()
    assert {path.name for path in kept.iterdir()} == {path.name for path in FOLDER.iterdir()}
    for path in FOLDER.iterdir():
        assert (kept / path.name).read_bytes() == path.read_bytes(), path.name
    assert {path.stem for path in (tmp_path / "pictures").iterdir()} == {"scaling", "ablation"}


def test_the_documentation_says_what_the_ablation_and_the_scaling_study_show():
    words = " ".join(documented.TEXT.split())
    rows = results(FOLDER / "ablation.csv")
    assert (rows["colliding_pairs"] > 0).all()
    assert f"all {len(rows)} platforms blow into themselves" in words
    deepest = rows["deepest_percent"]
    nearly, fully = ((deepest >= depth).mean() for depth in (REACHED, FULLY))
    assert (
        f"the median of the deepest overlap is {deepest.median():.0f} % of the largest possible; "
        f"{100 * nearly:.0f} % reach {REACHED:.0f} %, {100 * fully:.0f} % reach {FULLY} %" in words
    )
    few, fewer = json.loads((FOLDER / "scaling.json").read_text())["settings"]["topologies"]
    sizes = results(FOLDER / "scaling-direct.csv")["n"]
    assert f"{few} trees per size, above {Settings.few_above} modules {fewer}" in words
    assert f"for {sizes.min()} to {sizes.max()} modules also the paper's formulation written directly" in words
    rows = results(FOLDER / "scaling.csv")
    solved, clear = rows["status"] == "feasible", rows["verdict"] == "clear"
    assert clear.sum() == solved.sum()
    assert f"{solved.sum()} of {len(rows)} problems have a design, all with a clear audit" in words
    gaps = rows[(rows["n"] == 100) & solved].groupby("task")["gap"].median()
    low, high = gap_percent(gaps.min(), 1).removesuffix(" %"), gap_percent(gaps.max(), 1)
    assert f"With 100 modules the median gap of first designs is {low} to {high}" in words


def test_the_documentation_says_what_a_set_of_hinge_angles_costs():
    page = (documented.ROOT / "tests/benchmarks/README.md").read_text(encoding="utf-8")
    rows = pd.concat(map(results, sorted(FOLDER.glob("hinges*.csv"))), ignore_index=True)
    table = experiment("hinges").summary(rows)
    for (task, n), group in table.groupby(["task", "n"]):
        _, *sets = group.to_dict(orient="records")
        cells = [
            f"{100 * (row['best_ratio'] - 1):.1f} % ({row['trees_solved']})".replace("nan % (0)", "none")
            for row in sets
        ]
        assert f"| `{task}`, {n} | {' | '.join(cells)} |" in page
