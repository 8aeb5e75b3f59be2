"""Searches of trees of several types: moves and rows lead to all of them, and samplers propose them all."""

from collections import Counter
from itertools import product
from math import comb
from random import Random
from typing import Any

import numpy as np
import pytest
from toy_problem import follow

from topo_search.engine.own_sampler import TopologySampler
from topo_search.engine.proposals import OptunaSearch
from topo_search.engine.proposals.moves import descriptors, draw_move, graft, make_move, part_of
from topo_search.engine.proposals.trials import decode, encode, ranges
from topo_search.engine.strategy import Candidates, Proposal, Tried
from topo_search.model import BadInput, Topology
from topo_search.model.stated import Stated
from topo_search.model.task_file import read_task
from topo_search.study.request import Request, UserInputs
from topo_search.topologies import Connectors, candidate_of, candidates, count, sample

BATTERY = "module_types=[{name='X',count=3},{name='battery',count=1,rotors=[]}]"


def request(connectors: str = "aligned", **options: Any) -> Request:
    task = read_task("push", ("modules=4", BATTERY, f"search.connectors={connectors}"))
    return Request(task, "task", 4, 0, **options)


def space(connectors: str = "aligned") -> Candidates:
    return request(connectors).space(4)


# ---- Moves.


def test_exchanges_keep_the_tree_and_reach_all_of_its_colourings() -> None:
    random, waiting = Random(0), [Topology.from_key("a71000-aaabb")]
    reached: set[str] = set()
    while waiting:
        tree = waiting.pop()
        reached.add(tree.key)
        exchanges = [move for _ in range(100) if len(move := draw_move(tree, random, "aligned")) == 2]
        assert 25 < len(exchanges) < 75
        for other in (make_move(tree, move) for move in exchanges):
            assert other.joints == tree.joints
            assert sum(a != b for a, b in zip(tree.types, other.types, strict=True)) == 2
            if other.key not in reached:
                waiting.append(other)
    assert len(reached) == comb(5, 2)


@pytest.mark.parametrize("connectors", ["aligned", "any"])
def test_a_part_that_is_cut_off_keeps_its_types(connectors: Connectors) -> None:
    random = Random(1)
    for tree in sample(9, 60, 0, counts=(4, 3, 2), symmetry="none", connectors=connectors):
        i = random.randrange(1, tree.n)
        part = part_of(tree, i)
        at = random.choice([port for port in tree.free_connectors if port[0] not in part])
        place = {old: new for new, old in enumerate([h for h in range(9) if h not in part] + sorted(part))}
        other = graft(tree, i, at)
        assert [other.types[place[h]] for h in range(9)] == list(tree.types)
        h, a, _ = tree.joints[i]
        assert graft(other, place[i], (place[h], a)).key == tree.key


@pytest.mark.parametrize(("counts", "connectors"), [((2, 1, 1), "aligned"), ((2, 1), "any")])
def test_moves_lead_from_any_candidate_to_all(counts: tuple[int, ...], connectors: Connectors) -> None:
    listed = {candidate.key for candidate in candidates(sum(counts), counts=counts, connectors=connectors)}
    random, reached, waiting = Random(4), set[str](), [min(listed)]
    while waiting:
        tree = Topology.from_key(waiting.pop())
        reached.add(tree.key)
        others = (make_move(tree, draw_move(tree, random, connectors)) for _ in range(60))
        keys = {candidate_of(other, counts=counts, connectors=connectors).key for other in others}
        assert keys <= listed
        waiting.extend(keys - reached - set(waiting))
    assert reached == listed


@pytest.mark.parametrize("connectors", ["aligned", "any"])
def test_the_twin_of_a_twin_is_the_candidate_itself(connectors: str) -> None:
    own = space(connectors)
    twins = {candidate: own.twin_of(candidate.topology) for candidate in own.candidates()}
    assert all(twins[twin] == candidate for candidate, twin in twins.items())
    assert any(twin != candidate for candidate, twin in twins.items())


# ---- Rows of numbers.


@pytest.mark.parametrize(
    ("counts", "connectors"), [((1, 1), "any"), ((2, 1), "any"), ((1, 1, 1), "aligned"), ((3, 1), "aligned")]
)
def test_the_rows_are_all_candidates_and_nothing_else(counts: tuple[int, ...], connectors: Connectors) -> None:
    n = sum(counts)
    names = ranges(n, connectors, counts)
    rows = (dict(zip(names, values, strict=True)) for values in product(*map(range, names.values())))
    options: dict[str, Any] = {"counts": counts, "connectors": connectors}
    keys = {candidate_of(decode(row, n, counts), **options).key for row in rows}
    assert keys == {candidate.key for candidate in candidates(n, **options)}


@pytest.mark.parametrize("counts", [(7, 5, 2), (13, 1), (14,)])
def test_a_tree_is_read_back_from_its_row(counts: tuple[int, ...]) -> None:
    names = ranges(14, "any", counts)
    for tree in sample(14, 40, 3, counts=counts, symmetry="none", connectors="any"):
        row = encode(tree, "any")
        assert row.keys() == names.keys()
        assert all(0 <= row[name] < values for name, values in names.items())
        assert decode(row, 14, counts).key == tree.key


# ---- What trees are compared by.


def test_descriptors_tell_types_and_not_the_root() -> None:
    trees = list(map(Topology.from_key, ("a7000-aaab", "a7000-aaba", "a7000-baaa", "a7000")))
    *described, plain = (descriptors([tree])[0].tolist() for tree in trees)
    assert all(row[: len(plain)] == plain and len(row) == len(plain) + 6 for row in described)
    assert len({tuple(row) for row in described}) == 3
    hub, rest = described[2][-3:], described[2][-6:-3]  # the battery in the middle of a T: 1/4 from the mean
    assert hub == pytest.approx([1 / 16, 1 / 4, 3])
    assert rest == pytest.approx([(17 + 17 + 9) / 48, 1 / 12, 1])
    for tree in sample(8, 40, 0, counts=(5, 2, 1), symmetry="none", root="paper", connectors="any"):
        other = candidate_of(tree, symmetry="c2", connectors="any").topology
        assert np.array_equal(*descriptors([tree, other]))


# ---- Samplers.


class Formula:
    """Answers that the battery is best in the middle of a chain, and what was proposed."""

    def __init__(self) -> None:
        self.proposals: list[Proposal] = []
        self.told = 0

    def begin_stage(self, *_: object) -> None:
        pass

    def submit(self, proposal: Proposal) -> None:
        self.proposals.append(proposal)

    def results(self, number: int) -> list[Tried]:
        due = self.proposals[self.told : self.told + number]
        self.told += number
        return [self.result(proposal.candidate.key, proposal.starts) for proposal in due]

    @staticmethod
    def result(key: str, starts: int) -> Tried:
        tree = Topology.from_key(key)
        assert Counter(tree.types) == {0: tree.n - 1, 1: 1}
        return Tried(key, starts, "feasible", 1.0 + float(tree.distances[tree.types.index(1)].sum()), None)


@pytest.mark.parametrize(
    ("sampler", "connectors"),
    [("moves", "any"), ("moves", "aligned"), ("tpe", "aligned"), ("nsga2", "any"), ("random", "aligned")],
)
def test_samplers_propose_all_candidates_and_no_other(sampler: str, connectors: str) -> None:
    own = space(connectors)
    listed = {candidate.key: candidate for candidate in own.candidates()}
    assert len(listed) == own.count() == count(4, task=own.task, symmetry="task", connectors=connectors)
    solver = Formula()
    follow(OptunaSearch(own, sampler=sampler, trials=1000, round_size=8, starts=4, seed=1), solver)
    assert {proposal.candidate.key for proposal in solver.proposals} == listed.keys()
    assert all(listed[proposal.candidate.key] == proposal.candidate for proposal in solver.proposals)


def test_moves_find_the_best_of_many_trees_sooner_than_uniform_draws() -> None:
    task = read_task("push", ("modules=10", BATTERY.replace("3", "9"))).resolve(10)
    best = {"moves": 0.0, "random": 0.0}
    for sampler, seed in product(best, range(3)):
        solver = Formula()
        own = Request(task, "task", 1, 0).space(10)
        follow(OptunaSearch(own, sampler=sampler, trials=100, round_size=8, starts=1, seed=seed), solver)
        best[sampler] += min(solver.result(each.candidate.key, 1).objective or 0.0 for each in solver.proposals)
    assert best["moves"] < best["random"] - 2


class Listing:
    """A user's sampler that proposes what it was given."""

    def __init__(self, *proposals: Any) -> None:
        self.proposals = list(proposals)

    def propose(self, *_: object) -> Any:
        return self.proposals.pop(0)


def test_a_users_sampler_proposes_trees_with_types() -> None:
    assert isinstance(Listing(), TopologySampler)
    graph = Topology.from_key("a7000-aaba").graph()
    sampler = Listing("a3010-aaab", graph, "a7000")
    search = OptunaSearch(space(), sampler=lambda _: sampler, trials=9, round_size=8, starts=1, seed=0)
    proposed = [search.ask(), search.ask()]
    assert [each.candidate.key for each in proposed if isinstance(each, Proposal)] == [
        space().key_of(Topology.from_key(key)) for key in ("a3010-aaab", "a7000-aaba")
    ]
    with pytest.raises(BadInput, match="must be of 3 a, 1 b, but got a7000"):
        search.ask()


# ---- Requests.


def test_a_request_lists_the_trees_of_its_types() -> None:
    own = request()
    assert own.quotient(4).exact
    assert own.covers(4)
    assert own.space(4).count() == 26
    given = ("a3010-aaab", "a3010-aaba")
    listed = request(user_inputs=UserInputs(topologies=given))
    assert [candidate.key for candidate in listed.space(4).candidates()] == list(given)
    assert not listed.covers(4)
    all_of_them = tuple(candidate.key for candidate in own.space(4).candidates())
    assert request(user_inputs=UserInputs(topologies=all_of_them)).covers(4)


def test_every_rooted_tree_is_a_candidate_where_numbers_of_modules_matter() -> None:
    rooted = request(user_inputs=UserInputs(constraints=(Stated(name="own", version="1"),)))
    assert rooted.space(4).count() == count(4, counts=(3, 1), root="paper", symmetry="none")
    assert all(candidate.orbit == 1 for candidate in rooted.space(4).candidates())
