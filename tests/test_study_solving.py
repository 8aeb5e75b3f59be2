import itertools
import math
import time
from dataclasses import replace

import pytest
import toy_problem
from ledger_edit import altered
from older import older_task
from processes import table
from toy_problem import InProcess, solved_keys, toy_run, toy_task

from topo_search.engine import Candidates, Job, Proposal, Strategy
from topo_search.engine.strategy import WAIT, ExhaustiveSearch
from topo_search.model import BadInput, Topology
from topo_search.study import Request, RunFolder, SilentObserver, read_answer
from topo_search.study.solving import ProposedJobs, Tools


class Scripted(Strategy):
    """Proposes what a script says, and keeps the results that it was told."""

    def __init__(self, script, space):
        super().__init__()
        self.told = []
        self.script = script(space, self.told)
        self.proposals, self.open = [*next(self.script)], 0

    def ask(self):
        if not self.proposals:
            if len(self._results) < self.open:
                return WAIT
            scores, self._results, self.open = self._results, [], 0
            try:
                self.proposals = [*self.script.send(scores)]
            except StopIteration:
                return None
        self.open += 1
        return self.proposals.pop(0)


def halving(space, told):
    """Propose all candidates, then the better half of them from more starts, and so on."""
    proposals, starts = [Proposal(candidate, 1) for candidate in space.candidates()], 1
    while len(proposals) > 1:
        scores = yield proposals
        told.append(scores)
        assert [scored.key for scored in scores] == [proposal.candidate.key for proposal in proposals]
        assert all(scored.starts >= starts for scored in scores)
        starts *= 2
        order = sorted(range(len(scores)), key=lambda i: (scores[i].objective or math.inf, scores[i].violation))
        proposals = [Proposal(proposals[i].candidate, starts) for i in order[: len(order) // 2]]


def run_strategy(path, *, until=math.inf, strategy=halving):
    """Run a strategy in a run's folder; return whether it ended and the results that it collected."""
    request = Request(toy_task(4), "c2", 9, 0)
    scripted = Scripted(strategy, request.space(4))
    with RunFolder.open(path, request) as folder:
        folder.ledger.add_context(request.contexts(4)[0], toy_problem.BOUND, None)
        tools = Tools(toy_problem.BACKENDS, InProcess(1), SilentObserver(), until)
        jobs = ProposedJobs(scripted, folder, 4, toy_problem.BOUND, tools.observer)
        for job, outcome in tools.solve(jobs):
            jobs.record(job, outcome)
        return jobs.is_finished, scripted.told


def test_a_strategy_is_told_the_value_of_every_proposal(tmp_path, log):
    ended, told = run_strategy(tmp_path / "run")
    assert ended
    assert [len(scores) for scores in told] == [14, 7, 3]
    for starts, scores in zip((1, 2, 4), told, strict=True):
        for scored in scores:
            assert (scored.starts, scored.status, scored.violation) == (starts, "feasible", None)
            values = [toy_problem.value(scored.key, s, 0, 1e-4) for s in range(starts)]
            assert scored.objective == min(values)
    assert len(solved_keys(log)) == 14 + 7 + 3


def test_a_stopped_search_is_told_the_same_when_it_is_replayed_and_solves_nothing_twice(tmp_path, monkeypatch, log):
    whole = run_strategy(tmp_path / "whole")
    solves = solved_keys(log)
    log.write_text("")
    ticks = itertools.count()
    monkeypatch.setattr(time, "monotonic", lambda: float(next(ticks)))
    ended, stops = False, 0
    while not ended:  # a few solves at a time
        ended, told = run_strategy(tmp_path / "run", until=next(ticks) + 5)
        assert told == whole[1][: len(told)]
        stops += not ended
    assert stops > 4
    assert (ended, told) == whole
    assert solved_keys(log) == solves
    assert run_strategy(tmp_path / "run") == whole
    assert solved_keys(log) == solves


def test_what_has_no_design_comes_with_its_violation(tmp_path, monkeypatch):
    monkeypatch.setenv("TOY_NONE", "*")
    _, told = run_strategy(tmp_path / "run")
    unit = toy_task(4).resolve(4).torque_unit(4)
    for scored in told[0]:
        assert scored.objective is None
        assert scored.violation == pytest.approx(toy_problem.value(scored.key, 0, 0, 1e-4) / unit)


def warm_starting(space, told):
    first, second, third = itertools.islice(space.candidates(), 3)
    told.append((yield [Proposal(first, 1)]))
    told.append((yield [Proposal(second, 3, warm_starts=(first.key,)), Proposal(third, 1)]))
    told.append((yield [Proposal(first, 2), Proposal(third, 3, warm_starts=(second.key,))]))


def test_a_design_is_carried_over_in_place_of_the_next_start(tmp_path, log):
    run_strategy(tmp_path / "run", strategy=warm_starting)
    first, second, third = (
        c.key for c in itertools.islice(Candidates(toy_task(4).resolve(4), "c2").candidates(), 3)
    )
    carried = [(line.split()[0], line.split()[3:]) for line in log.read_text().splitlines()]
    assert carried == [(first, []), (second, [first]), (third, []), (first, []), (third, [second])]
    with RunFolder.load(tmp_path / "run") as folder:
        rows = {row.key: row for row in folder.ledger.ranking(4)}
    assert [(rows[key].asked, rows[key].starts) for key in (first, second, third)] == [(2, 2), (3, 2), (3, 2)]
    for key, starts in ((second, (1, 2)), (third, (0, 2))):
        assert rows[key].objective == min(toy_problem.value(key, start, 0, 1e-4) for start in starts)


def test_designs_may_stand_for_all_of_the_first_starts(tmp_path, log):
    def carried_over_alone(space, told):
        first, second, third = itertools.islice(space.candidates(), 3)
        told.append((yield [Proposal(first, 1), Proposal(second, 1)]))
        told.append((yield [Proposal(third, 2, warm_starts=(first.key, second.key))]))
        told.append((yield [Proposal(third, 4)]))

    ended, told = run_strategy(tmp_path / "run", strategy=carried_over_alone)
    lines = [line.split() for line in log.read_text().splitlines()]
    assert ended
    assert [line[3:] for line in lines] == [[], [], [told[0][0].key, told[0][1].key], []]
    third = told[1][0].key
    values = [toy_problem.value(third, start, 0, 1e-4) for start in (-2, -1, 2, 3)]
    assert [scores[0].objective for scores in told[1:]] == [min(values[:2]), min(values)]


def test_a_tree_without_a_design_is_no_warm_start(tmp_path, monkeypatch, log):
    monkeypatch.setenv("TOY_NONE", next(Candidates(toy_task(4).resolve(4), "c2").candidates()).key)
    _, told = run_strategy(tmp_path / "run", strategy=warm_starting)
    assert [scored.starts for scored in told[1]] == [3, 1]
    assert [len(line.split()) for line in log.read_text().splitlines()] == [3, 3, 3, 3, 4]


def test_more_starts_that_fail_leave_what_was_known(tmp_path, monkeypatch):
    toy_run(tmp_path / "run", starts=1)
    with RunFolder.load(tmp_path / "run") as folder:
        before = list(folder.ledger.ranking(3))
    monkeypatch.setenv("TOY_SEGFAULT", before[0].key)
    assert toy_run(tmp_path / "run", starts=4, workers=1).sizes[0].complete
    with RunFolder.load(tmp_path / "run") as folder:
        (row,) = (row for row in folder.ledger.ranking(3) if row.key == before[0].key)
        scores = [scored for scored in folder.ledger.scores(folder.request.contexts(3)[0]) if scored.key == row.key]
    assert (row.objective, row.starts, row.asked, row.audit) == (before[0].objective, 1, 4, "clear")
    assert [(scored.starts, scored.objective) for scored in scores] == [(1, row.objective)]
    monkeypatch.delenv("TOY_SEGFAULT")
    assert toy_run(tmp_path / "run", starts=4).best == toy_run(tmp_path / "whole", starts=4).best


def test_a_ledger_without_maximised_values_is_read_and_upgraded(tmp_path):
    answer = toy_run(tmp_path / "run")
    path = tmp_path / "run" / "ledger.sqlite"
    columns = [f"ALTER TABLE candidates DROP COLUMN {name}" for name in ("value", "value_bound", "reach")]
    columns = ["DROP INDEX ranking", *columns, "ALTER TABLE solves DROP COLUMN value"]
    columns += ["CREATE INDEX ranking ON candidates (context, objective, key)", "PRAGMA user_version = 9"]
    altered(tmp_path / "run", *columns)
    content = path.read_bytes()
    assert read_answer(tmp_path / "run").best == answer.best
    assert path.read_bytes() == content
    assert toy_run(tmp_path / "run").best == answer.best
    assert path.read_bytes() != content


def test_a_ledger_of_an_older_version_is_refused_and_left_as_it_is(tmp_path):
    toy_run(tmp_path / "run")
    path = tmp_path / "run" / "ledger.sqlite"
    altered(tmp_path / "run", "PRAGMA user_version = 3")
    content = path.read_bytes()
    with pytest.raises(BadInput, match=r"has version 3, but this program reads version 10; it is left unchanged"):
        toy_run(tmp_path / "run")
    assert path.read_bytes() == content


# ---- pruning


def test_a_design_that_meets_the_bound_spares_the_rest_which_is_counted(tmp_path, monkeypatch, log):
    keys = sorted(table_of_all(tmp_path))
    ahead = (
        ExhaustiveSearch.lookahead + 3
    )  # for each result before the one that meets the bound another one was proposed
    monkeypatch.setenv("TOY_OPTIMAL", keys[3])
    log.write_text("")
    answer = toy_run(tmp_path / "run", modules=5, prune=True)
    (size,) = answer.sizes
    assert solved_keys(log) == keys[:ahead]
    assert answer.best.key == keys[3]
    assert size.complete
    assert size.statuses == {"feasible": ahead, "pruned": len(keys) - ahead}
    proven = "proven: no 5-module topology is better"
    assert size.statement == f"the best found of all {len(keys)} candidates; {proven}"
    rows = table(tmp_path / "run")
    assert [key for key in keys if rows[key]["status"] == "pruned"] == keys[ahead:]
    assert {rows[key]["starts"] for key in keys[ahead:]} == {"0"}
    log.write_text("")
    assert toy_run(tmp_path / "run", modules=5, prune=True) == answer
    assert toy_run(tmp_path / "run", modules=5, starts=9, prune=True).sizes[0].complete
    assert set(solved_keys(log)) <= set(keys[:ahead])
    with RunFolder.load(tmp_path / "run") as folder:
        assert folder.request.prune
        assert {solve.key for solve in folder.ledger.solves(5)} == set(keys[:ahead])


def table_of_all(tmp_path):
    toy_run(tmp_path / "all", modules=5)
    return table(tmp_path / "all")


def test_what_was_skipped_for_a_design_that_fails_its_audit_is_solved_after_all(tmp_path, monkeypatch):
    keys = sorted(table_of_all(tmp_path))
    monkeypatch.setenv("TOY_OPTIMAL", keys[3])
    monkeypatch.setenv("TOY_VIOLATED", keys[3])
    answer = toy_run(tmp_path / "run", modules=5, prune=True)
    assert answer.sizes[0].complete
    assert answer.sizes[0].statuses == {"feasible": len(keys)}
    whole = toy_run(tmp_path / "whole", modules=5)
    assert (answer.best, answer.sizes) == (whole.best, whole.sizes)


def test_a_region_of_many_corners_has_the_time_that_its_starts_take():
    """96 struts of 20 corners take three modules 137 s per start: CPU time, alone on a core."""
    strut = [[x, y, 0.1 * z] for x in (0.0, 0.1) for y in (0.0, 0.1) for z in range(5)]
    pieces = [[[x + 0.2 * k, y, z] for x, y, z in strut] for k in range(96)]
    exposure = {"kind": "local", "pieces": pieces}
    task = older_task(name="t", modules=3, load_cases=[{"carries_weight": True}], exposure=[exposure])
    job = Job(task.resolve(3), Topology.from_key("a300"), range(2), 0)
    assert job.deadline > 2 * 5 * 137
    assert replace(job, task=toy_task().resolve(3)).deadline == 160.0


def test_nothing_is_pruned_while_the_bound_leaves_room(tmp_path):
    pruned, whole = (toy_run(tmp_path / str(prune), modules=4, prune=prune) for prune in (True, False))
    assert pruned.sizes == whole.sizes
    gap = math.ceil(1e4 * (1 - toy_problem.BOUND / whole.best.objective)) / 100  # what is proven is rounded up
    assert whole.sizes[0].statement == (
        f"the best found of all 14 candidates; proven: no 4-module topology is more than {gap:.2f} % better"
    )
