"""The page of a large run stays small: ten thousand candidates, solved twice each."""

import itertools
import json
import math
import re
from dataclasses import replace

from toy_problem import BOUND, lower_bound, solve, toy_task, value

from topo_search.model import Design, Infeasible
from topo_search.report.run_page import write_run_page
from topo_search.study import Request, RunFolder
from topo_search.study.answer import SHOWN
from topo_search.study.ledger import Row, row_of
from topo_search.topologies import Candidate, candidates

NUMBER = 10_000


def result(number: int, candidate: Candidate, solved: Design) -> tuple[Row, Design | Infeasible]:
    """Return what becomes of a candidate: every third is infeasible, the others are copies of one design."""
    key, margin = candidate.key, solved.task.search.margin
    if number % 3 == 0:
        outcome = Infeasible(
            topology=candidate.topology,
            topology_key=key,
            status="infeasible",
            worst_constraint=f"airflow of modules {number % 7} and {number % 7 + 1}",
            violation=0.001 * number,
            unit="m",
            message="missed",
        )
    else:
        objective = value(key, 0, 0, margin)
        inputs = ((math.sqrt(objective / 36),) * 36,)
        own = {"topology": candidate.topology, "topology_key": key, "objective": objective}
        outcome = solved.model_copy(update={**own, "rotor_speeds_squared": inputs})
    row = row_of(outcome, key=key, modules=9, orbit=1, starts=1, lower_bound=BOUND)
    return replace(row, margin=margin), outcome


def test_ten_thousand_candidates_take_less_than_six_megabytes(tmp_path):
    request = Request(toy_task(9), "none", starts=1, seed=0)
    (context, *_), path = request.contexts(9), tmp_path / "run"
    with RunFolder.open(path, request) as folder:
        folder.ledger.begin(context, lower_bound(context.task), None)
        drawn = list(itertools.islice(candidates(9), NUMBER))
        assert len(drawn) == NUMBER
        solved = solve(context.task, drawn[0].topology, starts=range(1), seed=0)
        rows = [result(number, candidate, solved) for number, candidate in enumerate(drawn)]
        ranked = sorted(rows, key=lambda pair: (pair[0].objective or math.inf, pair[0].key))
        shown = {row.key for row, _ in ranked[:SHOWN]}
        for _ in range(2):
            folder.ledger.record(context, [(row, found if row.key in shown else None) for row, found in rows])
        write_run_page(folder)
    page = path / "report.html"
    assert page.stat().st_size < 6e6
    text = page.read_text(encoding="utf-8")
    (data,) = re.findall(r'id="ranking-data">(.*?)</script>', text, re.DOTALL)
    assert len(json.loads(data)["rows"]) == NUMBER
    assert "airflow of two modules" in text
    assert text.count("<tr>") < 200
