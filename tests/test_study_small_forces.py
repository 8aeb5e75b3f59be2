"""Forces that are small beside the weight: what is proven allows for the audit's tolerance, a large share of them.

The design in `designs/small-force.json` is clear, and costs a sixth less than any that meets its wrench exactly.
"""

import math
import re
from dataclasses import replace
from pathlib import Path

import pytest
from older import older_task
from test_study_proving import Prover, proven, table
from toy_problem import toy_run

import nlp
from topo_search.cli.tables import answer_lines
from topo_search.compose import audit, write_report
from topo_search.compose.binding import BACKENDS
from topo_search.engine import Failed
from topo_search.model import Design, Status
from topo_search.model.files import read_json
from topo_search.report.run_page import run_page
from topo_search.study import RunFolder

FILE = Path(__file__).parent / "designs" / "small-force.json"
CHEAPER = read_json(Design, FILE)
TASK = older_task(
    name="smallforce",
    modules=2,
    load_cases=[{"units": "SI", "com": {"force": [0.0, 0.0, 5.2e-5]}}],
    end_effector={"rod": "none", "mass": 0.0, "position": "com", "exclusion": False},
)


def run(path, solve):
    def only(job):
        return solve(job) if job.topology.key == "a20" else Failed("error", "left out")

    return toy_run(path, task=TASK, symmetry="task", backends=replace(BACKENDS, solve=only, audit=audit))


def test_a_clear_design_may_cost_less_than_one_that_meets_its_wrench_exactly():
    assert audit(CHEAPER).verdict == Status.CLEAR
    assert nlp.proven_bound(CHEAPER.task) < CHEAPER.objective < nlp.lower_bound(CHEAPER.task)


def test_no_figure_that_is_proven_excludes_a_clear_design(tmp_path, log, capsys):
    run(tmp_path / "run", BACKENDS.solve)
    answer = proven(tmp_path / "run", Prover(refuses=("a10", "a20")), gap=0.005)
    best = answer.best.objective
    assert best > 1.2 * CHEAPER.objective
    print(*answer_lines(answer), sep="\n")
    told = capsys.readouterr().out
    with RunFolder.load(tmp_path / "run") as folder:
        page = run_page(folder)
    sentences = [
        told,
        page["answer"],
        *page["bound"],
        *(tile.figure for tile in page["tiles"] if "gap" in tile.name),
    ]
    gaps = [float(one) for text in sentences for one in re.findall(r"([\d.]+) %(?! of the least)", text)]
    assert len(gaps) >= 6
    assert all(best * (1 - gap / 100) <= CHEAPER.objective for gap in gaps)
    row = table(tmp_path / "run")["a20"]
    assert row["proof"] == "open"
    assert float(row["proven_bound"]) <= CHEAPER.objective
    assert float(row["lower_bound"]) <= CHEAPER.objective
    assert best * (1 - float(row["proven_gap"])) <= CHEAPER.objective
    (size,) = answer.sizes
    assert size.lower_bound <= CHEAPER.objective


def test_a_run_whose_best_design_is_below_the_exact_bound_is_no_damage(tmp_path, log):
    """Its page and its ranking have a gap that the bound leaves."""
    answer = run(tmp_path / "run", lambda job: CHEAPER.model_copy(update={"task": job.task}))
    assert answer.best.objective == CHEAPER.objective
    assert answer.best.gap == pytest.approx(1 - answer.sizes[0].lower_bound / CHEAPER.objective)
    assert answer.best.gap > 0.1


def test_the_page_of_a_design_below_the_exact_bound_claims_no_gap_of_zero(tmp_path):
    page = write_report(FILE, out=tmp_path / "page.html").read_text()
    gap = math.ceil(1e4 * (1 - nlp.proven_bound(CHEAPER.task) / CHEAPER.objective)) / 100
    assert f"{gap:.2f} %" in page
    assert "0.00 %" not in page
