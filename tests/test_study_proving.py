"""Proofs of a run's trees: kept chunk by chunk, taken up again, and said in the table and the answer."""

import json
import math
from itertools import islice

import pytest
import toy_problem
from ledger_edit import rewritten
from older import older_task
from processes import table
from toy_problem import InProcess, toy_run, toy_task
from wording import says

from topo_search.model import BadInput, Chunk, Proof
from topo_search.model.exposure import Allowed, Local, Plane
from topo_search.model.proof import chunk_count
from topo_search.model.proven import gap_percent
from topo_search.report.run_page import run_page
from topo_search.report.task_facts import facts
from topo_search.study import RunFolder, SilentObserver, answer_of, prove
from topo_search.study.proofs import candidates_of, problem, proofs_hold_for, proofs_of, target
from topo_search.study.tables import candidates


class Prover:
    """Stands in for the branch and bound; remembers what it was asked."""

    def __init__(self, *, refuses=()):
        self.asked, self.refuses = [], refuses

    def __call__(self, task, topology, number, cut, problem):
        self.asked.append((topology.key, number, cut))
        self.problem = problem
        if topology.key in self.refuses:
            return Chunk.of(number, "stuck", b"", ((0.0,), (1.0,)))
        return Chunk.of(number, "closed", bytes([2, 0, 1]))


class Bounded(Prover):
    """Cannot close one tree above a cut."""

    def __init__(self, key, cut):
        super().__init__()
        self.key, self.cut = key, cut

    def __call__(self, task, topology, number, cut, problem):
        found = super().__call__(task, topology, number, cut, problem)
        if topology.key == self.key and cut > self.cut and number == 5:
            return Chunk.of(number, "stuck", b"", ((0.0,), (1.0,)))
        return found


def proven(path, prover, **options):
    given = {"gap": 0.01, "key": None, "engine": InProcess(1), "observer": SilentObserver(), **options}
    given = {"solve": toy_problem.solve} | given
    return prove(path, prover, lambda task, tree: 0, **given)


class Stopped(InProcess):
    """Runs some jobs, then raises an exception, or without one stops as at a time limit."""

    def __init__(self, jobs, error):
        super().__init__(1)
        self.jobs, self.error = jobs, error

    def run(self, function, jobs, *, deadline, until=math.inf):
        yield from super().run(function, islice(jobs, self.jobs), deadline=deadline, until=until)
        if self.error is not None:
            raise self.error


@pytest.fixture
def run(tmp_path, log):
    toy_run(tmp_path / "run")
    return tmp_path / "run"


def test_every_tree_is_excluded_or_within_the_gap(run):
    answer = proven(run, Prover())
    rows, best = table(run), answer.best.objective
    for row in rows.values():
        near = float(row["objective"]) * 0.99 < best
        assert row["proof"] == ("within" if near else "excluded")
        assert float(row["proven_bound"]) == pytest.approx(float(row["objective"]) * 0.99 if near else best)
        assert float(row["proven_gap"]) == pytest.approx(1 - float(row["proven_bound"]) / float(row["objective"]))
    assert "no 3-module topology is more than 1.00 % better" in answer.sizes[0].proven
    assert list(candidates(run)["proof"]) == [row["proof"] for row in rows.values()]


def test_what_is_proven_is_not_searched_again_and_a_smaller_gap_is(run):
    first, again, finer = Prover(), Prover(), Prover()
    proven(run, first)
    proven(run, again)
    assert not again.asked
    proven(run, finer, gap=0.001)
    assert {key for key, _, _ in finer.asked} <= {key for key, _, _ in first.asked}
    assert finer.asked


def test_what_compiles_is_called_once_before_the_first_chunk_and_spends_no_time_limit(run, monkeypatch):
    now, prepared, prover = 0.0, [], Prover()
    monkeypatch.setattr("time.monotonic", lambda: now)

    def prepare(task):
        nonlocal now
        assert not prover.asked
        prepared.append(task.n)
        now += 500.0

    answer = proven(run, prover, prepare=prepare, time_limit=200.0)
    assert prepared == [3]
    assert answer.sizes[0].proven_gap == pytest.approx(0.01)
    proven(run, Prover(), prepare=prepare)  # nothing is due
    assert prepared == [3]


def test_a_stopped_proof_goes_on_where_it_was(run):
    first, rest, whole = Prover(), Prover(), Prover()
    with pytest.raises(KeyboardInterrupt):
        proven(run, first, engine=Stopped(40, KeyboardInterrupt))
    assert "open" in {row["proof"] for row in table(run).values()}
    with RunFolder.load(run) as folder:
        assert answer_of(folder).sizes[0].proof_resumable
    answer = proven(run, rest)
    assert not set(first.asked) & set(rest.asked)
    toy_run(run.parent / "other")
    other = proven(run.parent / "other", whole)
    assert set(first.asked) | set(rest.asked) == set(whole.asked)
    assert answer.sizes == other.sizes


@pytest.mark.parametrize("gap", [0.01, 0.0025])
def test_a_complete_proof_stays_until_one_of_a_smaller_gap_is_complete(run, gap):
    first, rest = Prover(), Prover()
    earlier = proven(run, Prover(), gap=0.03)
    rows = table(run)
    with pytest.raises(RuntimeError):  # as if it were killed: nothing is written after the last chunk
        proven(run, first, gap=gap, engine=Stopped(40, RuntimeError))
    with RunFolder.load(run) as folder:
        answer = answer_of(folder)
        shown = {row.key: (state.proof, state.proven_bound) for row, state, _ in candidates_of(folder, 3)}
    assert shown == {key: (row["proof"], pytest.approx(float(row["proven_bound"]))) for key, row in rows.items()}
    assert answer.sizes[0].candidates_gap == earlier.sizes[0].candidates_gap == pytest.approx(0.03)
    assert not (stopped := proven(run, Prover(), gap=gap, engine=Stopped(0, None))).proven
    assert set(stopped.sizes[0].proof_open) & set(stopped.sizes[0].proof_resumable)
    assert proven(run, none := Prover(), gap=0.03).proven
    assert not none.asked
    assert (answer := proven(run, rest, gap=gap)).proven
    assert answer.sizes[0].candidates_gap == pytest.approx(gap)
    assert first.asked
    assert not set(first.asked) & set(rest.asked)
    assert all(float(table(run)[key]["proven_bound"]) >= float(rows[key]["proven_bound"]) for key in rows)
    assert not [*(run / "proof-unfinished").iterdir()]


def test_a_gap_that_cannot_be_closed_takes_nothing_from_a_larger_one(run):
    earlier = proven(run, Prover(), gap=0.03)
    key = earlier.best.key
    answer = proven(run, Prover(refuses=(key,)), gap=0.01)
    assert answer.sizes[0].candidates_gap == earlier.sizes[0].candidates_gap
    assert answer.sizes[0].proof_open == (key,)
    assert not answer.proven
    assert key not in answer.sizes[0].proof_resumable
    assert proven(run, again := Prover(), gap=0.01).sizes == answer.sizes
    assert not again.asked


def test_a_tree_that_cannot_be_closed_is_open_and_nothing_is_claimed(run):
    key = list(table(run))[-1]
    answer = proven(run, Prover(refuses=(key,)))
    row = table(run)[key]
    assert row["proof"] == "open"
    assert float(row["proven_bound"]) == toy_problem.BOUND
    assert "1 open; nothing new is proven for the size" in answer.sizes[0].proven
    assert f"the same command cannot close {key}: " in answer.sizes[0].proven
    assert not answer.sizes[0].proof_resumable
    again = Prover()
    assert proven(run, again).sizes == answer.sizes
    assert not again.asked


def test_a_tree_that_cannot_be_excluded_is_held_to_the_gap_under_the_best(run):
    """As where exposure, which no bound knows, is what keeps a tree from beating the best."""
    key, best = list(table(run))[-1], min(float(row["objective"]) for row in table(run).values())
    prover = Bounded(key, 0.99 * best)
    answer = proven(run, prover)
    row = table(run)[key]
    assert row["proof"] == "within"
    assert float(row["proven_bound"]) == pytest.approx(0.99 * best)
    assert "no 3-module topology is more than 1.00 % better" in answer.sizes[0].proven
    assert {cut for asked, _, cut in prover.asked if asked == key} == {best, 0.99 * best}
    assert Proof.model_validate_json((run / "proof" / key).read_text()).complete
    again = Bounded(key, 0.99 * best)
    assert proven(run, again).sizes == answer.sizes
    assert not again.asked
    for prover in (Bounded(key, 0.99 * best), again):  # a larger gap takes nothing back
        assert proven(run, prover, gap=0.02).proven
        assert {cut for _, _, cut in prover.asked} <= {best}
        assert float(table(run)[key]["proven_bound"]) == pytest.approx(0.99 * best)
    assert not again.asked


def test_one_tree_alone(run):
    key, prover = next(iter(table(run))), Prover()
    answer = proven(run, prover, key=key)
    assert {asked for asked, _, _ in prover.asked} == {key}
    assert len(prover.asked) == chunk_count(3)
    assert "not examined" in answer.sizes[0].proven


def test_what_there_is_nothing_to_prove_of_is_refused(run, tmp_path):
    with pytest.raises(BadInput, match="has no candidate a999"):
        proven(run, Prover(), key="a999")
    (tmp_path / "empty").mkdir()
    with pytest.raises(BadInput, match=r"no ledger\.sqlite"):
        proven(tmp_path / "empty", Prover())


def test_a_proof_of_another_task_does_not_count_and_a_damaged_one_is_named(run):
    proven(run, Prover())
    file = next((run / "proof").iterdir())
    text = json.loads(file.read_text())
    proof = Proof.model_validate_json(json.dumps(text))
    assert proof.complete
    assert proof.chunks[5].record == bytes([2, 0, 1])
    rewritten(run, f"proof/{file.name}", json.dumps(text | {"cut": "low"}))
    with pytest.raises(BadInput, match=rf"{file.name}.*cut"), RunFolder.load(run) as folder:
        proofs_of(folder, 3)


def test_a_record_that_is_cut_off_is_refused():
    chunk = Chunk.of(3, "closed", bytes(1000))
    cut = chunk.model_copy(update={"packed": chunk.packed[:8]})
    with pytest.raises(ValueError, match="the record of chunk 3"):
        _ = cut.record


def test_the_cut_is_the_best_unless_a_tree_is_as_good():
    row = toy_problem.toy_row("a300", objective=102.0, gap=0.1)
    assert target(row, 100.0, 0.01) == ("excluded", 100.0)
    aim, cut = target(row, 100.0, 0.03)
    assert aim == "within"
    assert cut == pytest.approx(98.94)


def test_a_proof_about_the_solvers_problem_says_so_and_the_tasks_serves_for_it(run):
    first, wider, served = Prover(), Prover(), Prover()
    answer = proven(run, first, problem="solver")
    assert first.problem == "solver"
    assert says(answer.sizes[0].proven, "solver's own distances", "0.0001 m")
    assert {row["proven_problem"] for row in table(run).values()} == {"solver"}
    answer = proven(run, wider)
    assert (wider.problem, set(wider.asked)) == ("task", set(first.asked))
    assert "solver" not in answer.sizes[0].proven
    proven(run, served, problem="solver")
    assert not served.asked
    assert {row["proven_problem"] for row in table(run).values()} == {"task"}


def exposed(task):
    return task.model_copy(update={"name": "toy-local", "exposure": (Local(radius=0.2),)})


def test_proofs_of_a_run_without_exposure_serve_for_one_with_it(run, tmp_path):
    """The same toy but for exposure: what is proven of the one holds of the other, and is not searched again."""
    proven(run, Prover())
    other, prover = tmp_path / "other", Prover()
    toy_run(other, task=exposed(toy_task()))
    answer = proven(other, prover, source_run=run, gap=0.02)
    assert not prover.asked
    assert "no 3-module topology is more than 1.00 % better" in answer.sizes[0].proven
    with RunFolder.load(run) as source, RunFolder.load(other) as folder:
        lent, taken = proofs_of(source, 3), proofs_of(folder, 3)
    assert {key: proof.chunks for key, proof in taken.items()} == {key: proof.chunks for key, proof in lent.items()}
    assert {proof.task.name for proof in taken.values()} == {"toy-local"}
    assert proven(other, prover, gap=0.02).sizes == answer.sizes
    assert not prover.asked
    proven(other, prover, source_run=run, gap=0.001)  # what proves less than is asked for is not taken
    assert prover.asked


def test_an_open_proof_or_one_of_another_task_serves_for_no_other(run, tmp_path):
    proven(run, Prover(refuses=table(run)))
    toy_run(tmp_path / "other", task=exposed(toy_task()))
    with pytest.raises(BadInput, match=r"has no complete proof that holds for toy-local, n = 3"):
        proven(tmp_path / "other", Prover(), source_run=run)
    proven(tmp_path / "other", Prover())
    toy_run(tmp_path / "heavy", task=toy_task().model_copy(update={"gravity": 3.7}))
    with pytest.raises(BadInput, match="only name and exposure may differ"):
        proven(tmp_path / "heavy", Prover(), source_run=tmp_path / "other")


def test_the_page_says_what_is_proven(run):
    with RunFolder.load(run) as folder:
        assert "proof" not in str(run_page(folder)["run"]["candidates"])
    proven(run, Prover())
    with RunFolder.load(run) as folder:
        page = run_page(folder)
    assert page["answer"].endswith("candidates, proven to within 1.00 %.")
    assert ("Proven gap", "1.00 %") in [(tile.name, tile.figure) for tile in page["tiles"]]
    assert says(page["bound"][-1], "Proven by branch and bound: no 3-module topology", "1.00 %")
    assert "proof" in [name for name, *_ in page["run"]["candidates"]["columns"]]
    assert any("within" in row for row in page["run"]["candidates"]["rows"])


@pytest.mark.parametrize("options", [{"listed": ("a300", "a500")}, {"symmetry": "d4"}])
def test_a_proof_of_some_trees_is_none_of_their_size(tmp_path, options):
    toy_run(tmp_path / "run", **options)
    answer = proven(tmp_path / "run", Prover())
    (size,) = answer.sizes
    assert (size.covers_size, size.proven_gap) == (False, None)
    assert size.candidates_gap == pytest.approx(0.01)
    assert answer.proven  # of what was searched nothing is open
    assert size.statement.startswith("the best of all 2 candidates, proven to within 1.00 %")
    assert "none of the 3-module candidates is more than 1.00 % better" in size.proven
    assert size.gap_of(size.best) == size.best.gap > 0.01
    with RunFolder.load(tmp_path / "run") as folder:
        page = run_page(folder)
    tiles = [page["tiles"], *(card["figures"] for card in page["run"]["cards"])]
    (shown, *others) = [next(tile for tile in some if tile.name == "Proven gap") for some in tiles]
    assert shown.figure == gap_percent(size.best.gap)
    assert all(tile.meaning == "no platform of 3 modules can save more control effort" for tile in (shown, *others))


def test_the_gap_of_a_size_that_is_proven_tree_by_tree_has_a_scope(run):
    (size,) = proven(run, Prover()).sizes
    assert size.covers_size
    assert "scope: aligned connectors, any orientation" in size.proven
    with RunFolder.load(run) as folder:
        page = run_page(folder)
    tiles = [page["tiles"], *(card["figures"] for card in page["run"]["cards"])]
    assert all("in the scope of the proofs" in str(some) for some in tiles)


PUSH = {"end_effector": {"force": [0.1, 0.0, 1.0]}}


@pytest.mark.parametrize(
    ("cases", "shared"),
    [
        ([PUSH], False),
        ([PUSH, {"end_effector": {"force": [-0.1, 0.0, 1.0]}}], True),
        ([{**PUSH, "vertices": [{"force": [0.0, 0.1, 1.0]}]}], True),
        ([{"carries_weight": True, "cone": {"axis": [1, 0, 0], "half_angle_deg": 60.0, "force": 0.2}}], True),
    ],
)
def test_proofs_of_a_platform_that_could_lean_say_that_it_does_not(tmp_path, cases, shared):
    """With another attitude for each of several wrenches, a platform could save effort."""
    task = older_task(name="toy", modules=3, load_cases=cases)
    run = tmp_path / "run"
    (found,) = toy_run(run, task=task).sizes
    (size,) = proven(run, Prover()).sizes
    with RunFolder.load(run) as folder:
        page = run_page(folder)
    (tile,) = [tile for tile in page["tiles"] if tile.name == "Proven gap"]
    told = [found.statement, size.statement, size.proven, tile.meaning]
    assert ["without leaning" in text for text in told] == 4 * [shared]
    assert any("one attitude" in text for text in page["bound"]) is shared
    stated = dict(fact for _, facts_of in facts(page["task"]) for fact in facts_of)
    assert ("attitude" in stated) is shared


def test_a_proof_names_what_its_bound_takes_in_beyond_load_cases():
    plain = toy_task().resolve(3)
    wall = plain.model_copy(update={"exposure": (Allowed(planes=(Plane(normal=(1.0, 0.0, 0.0)),)),)})
    reserve = wall.model_copy(update={"flight": plain.flight.model_copy(update={"torque_reserve": 0.1})})
    weak = reserve.model_copy(update={"search": reserve.search.model_copy(update={"peak_input": 0.9})})
    assert "; with" not in problem(plain, "task")
    assert "; with half-spaces that hold the airflow;" in problem(wall, "task")
    assert "; with reserves (points of the balls), half-spaces that hold the airflow;" in problem(reserve, "task")
    assert "; with reserves (corners around the balls), half-spaces" in problem(reserve, "solver")
    assert "reserves" not in problem(weak, "solver")
    for which, cases in (("hover", "hover"), ("all", "hover and load cases that carry the weight")):
        dead = plain.with_fields("flight", rotor_out=which).with_fields("module", min_input=0.1)
        assert f"; with {cases} with any one rotor dead, minimum inputs;" in problem(dead, "task")


@pytest.mark.parametrize("rod_mass", ["included", "ignored"])
def test_a_proof_tells_at_its_start_which_gap_the_mass_of_a_rod_leaves(tmp_path, log, rod_mass):
    task = older_task(toy_task().model_dump(), end_effector={"rod_mass": rod_mass})
    toy_run(tmp_path / "run", task=task)
    prover, told = Prover(), []

    class Listening(SilentObserver):
        def note(self, text):
            told.append((len(prover.asked), text))

    def without_mass(job):
        (best,) = job.near
        assert job.task.end_effector.rod_mass == "ignored"
        return best.model_copy(update={"objective": (1 - 0.04567) * best.objective})

    proven(tmp_path / "run", prover, solve=without_mass, observer=Listening())
    texts = [text for asked, text in told if "within reach" in text and asked == 0]
    assert len(texts) == (rod_mass == "included")
    assert all(
        says(text, "3 modules: no gap under 4.56 % is within reach", "so much less effort") for text in texts
    )


def test_a_proof_with_a_wall_is_none_of_a_task_without():
    plain = toy_task().resolve(3)
    wall = plain.model_copy(update={"exposure": (Allowed(planes=(Plane(normal=(1.0, 0.0, 0.0)),)),)})
    assert proofs_hold_for(plain, wall)
    assert proofs_hold_for(wall, wall)
    assert not proofs_hold_for(wall, plain)
