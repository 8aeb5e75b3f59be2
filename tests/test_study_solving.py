import itertools
import math
import sqlite3
import time

import pytest
import toy_problem
from toy_problem import InProcess, solved_keys, toy_run, toy_task

from topo_search.engine import Candidates, Proposal, Strategy
from topo_search.model import BadInput
from topo_search.study import Request, RunFolder, Silent
from topo_search.study.run import solve_proposals
from topo_search.study.solving import Tools


class Scripted(Strategy):
    """Proposes what a script says, and keeps the results that it was told."""

    def __init__(self, script, space):
        self.script, self.space, self.told = script, space, []
        super().__init__()

    def proposals(self):
        yield from self.script(self, self.space, self.told)

    def scores_of(self, *proposals):
        """Propose candidates, and return their results."""
        yield from proposals
        return (yield from self.results(len(proposals)))


def halving(strategy, space, told):
    """Propose all candidates, then the better half of them from more starts, and so on."""
    proposals, starts = [Proposal(candidate, 1) for candidate in space.candidates()], 1
    while len(proposals) > 1:
        scores = yield from strategy.scores_of(*proposals)
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
        folder.ledger.begin(request.contexts(4)[0], toy_problem.BOUND, None)
        tools = Tools(toy_problem.BACKENDS, InProcess(1), Silent(), until)
        return solve_proposals(scripted, folder, 4, toy_problem.BOUND, tools), scripted.told


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


def warm_starting(strategy, space, told):
    first, second, third = itertools.islice(space.candidates(), 3)
    told.append((yield from strategy.scores_of(Proposal(first, 1))))
    told.append((yield from strategy.scores_of(Proposal(second, 3, near=(first.key,)), Proposal(third, 1))))
    told.append((yield from strategy.scores_of(Proposal(first, 2), Proposal(third, 3, near=(second.key,)))))


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
    def carried_over_alone(strategy, space, told):
        first, second, third = itertools.islice(space.candidates(), 3)
        told.append((yield from strategy.scores_of(Proposal(first, 1), Proposal(second, 1))))
        told.append((yield from strategy.scores_of(Proposal(third, 2, near=(first.key, second.key)))))
        told.append((yield from strategy.scores_of(Proposal(third, 4))))

    ended, told = run_strategy(tmp_path / "run", strategy=carried_over_alone)
    lines = [line.split() for line in log.read_text().splitlines()]
    assert ended
    assert [line[3:] for line in lines] == [[], [], [told[0][0].key, told[0][1].key], []]
    third = told[1][0].key
    values = [toy_problem.value(third, start, 0, 1e-4) for start in (-2, -1, 2, 3)]
    assert [scores[0].objective for scores in told[1:]] == [min(values[:2]), min(values)]


def test_a_tree_without_a_design_is_no_warm_start(tmp_path, monkeypatch, log):
    first = next(Candidates(toy_task(4).resolve(4), "c2").candidates()).key
    monkeypatch.setenv("TOY_NONE", first)
    _, told = run_strategy(tmp_path / "run", strategy=warm_starting)
    assert [scored.starts for scored in told[1]] == [3, 1]
    assert [len(line.split()) for line in log.read_text().splitlines()] == [3, 3, 3, 3, 4]


def test_more_starts_that_fail_leave_what_was_known(tmp_path, monkeypatch):
    toy_run(tmp_path / "run", starts=1)
    with RunFolder.load(tmp_path / "run") as folder:
        before = list(folder.ledger.ranking(3))
    monkeypatch.setenv("TOY_SEGFAULT", before[0].key)
    answer = toy_run(tmp_path / "run", starts=4, workers=1)
    assert answer.sizes[0].complete
    with RunFolder.load(tmp_path / "run") as folder:
        (row,) = (row for row in folder.ledger.ranking(3) if row.key == before[0].key)
        scores = [scored for scored in folder.ledger.scores(folder.request.contexts(3)[0]) if scored.key == row.key]
    assert (row.objective, row.starts, row.asked, row.audit) == (before[0].objective, 1, 4, "clear")
    assert [(scored.starts, scored.objective) for scored in scores] == [(1, row.objective)]
    monkeypatch.delenv("TOY_SEGFAULT")
    assert toy_run(tmp_path / "run", starts=4).best == toy_run(tmp_path / "whole", starts=4).best


def test_a_ledger_of_an_older_version_is_refused_and_left_as_it_is(tmp_path):
    toy_run(tmp_path / "run")
    path = tmp_path / "run" / "ledger.sqlite"
    database = sqlite3.connect(path)
    database.execute("PRAGMA user_version = 3")
    database.close()
    content = path.read_bytes()
    with pytest.raises(BadInput, match=r"has version 3, but this program reads version 7; it is left unchanged"):
        toy_run(tmp_path / "run")
    assert path.read_bytes() == content
