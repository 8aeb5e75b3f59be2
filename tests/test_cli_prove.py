"""`topo-search prove`: what it prints, and its exit status; the branch and bound is a stand-in here."""

import json

import pytest
import toy_problem
from commands import invoke
from ledger_edit import altered
from older import older_task
from processes import table
from test_study_checking import Checker
from test_study_proving import Prover
from toy_problem import BACKENDS, InProcess, toy_run, toy_task

from topo_search import compose, search
from topo_search.model import BadInput
from topo_search.model.files import to_toml


@pytest.fixture
def run(tmp_path, log):
    toy_run(tmp_path / "run")
    return tmp_path / "run"


def stand_in(monkeypatch, prover):
    """Let proofs be of a stand-in, in this process, and pages be none."""
    monkeypatch.setattr("nlp.prove_chunk", prover)
    monkeypatch.setattr("nlp.prepare_proof", lambda *_: None)
    monkeypatch.setattr(compose.binding, "open_engine", lambda *_: InProcess(1))
    monkeypatch.setattr(compose.searching, "write_page", lambda folder: None)


def prove(monkeypatch, prover, *arguments, status=0):
    stand_in(monkeypatch, prover)
    return invoke("prove", *arguments, status=status)


def test_all_proven_ends_with_0_and_a_sentence(run, monkeypatch):
    done = prove(monkeypatch, Prover(), run, "--gap", "0.01")
    assert f"{next(iter(table(run)))}: within, J >= " in done.output
    assert "proven by branch and bound: no 3-module topology is more than 1.00 % better" in done.output


def test_an_open_tree_ends_with_4_and_json_says_which(run, monkeypatch):
    key = list(table(run))[-1]
    done = prove(monkeypatch, Prover(refuses=(key,)), run, "--json", status=4)
    told = json.loads(done.stdout)
    assert [row["key"] for row in told["candidates"] if row["proof"] == "open"] == [key]
    assert "run the same command" not in done.stderr


def test_one_tree_that_is_proven_ends_with_0_whatever_the_rest(run, monkeypatch):
    key = next(iter(table(run)))
    done = prove(monkeypatch, Prover(), run, "--topology", key)
    assert [line for line in done.stdout.splitlines() if ": within" in line or "not examined, " in line]


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["nowhere"], "nowhere"),
        (["RUN", "--topology", "a999"], "has no candidate a999"),
        (["RUN", "--gap", "0"], "--gap"),
    ],
)
def test_bad_input_ends_with_2(run, monkeypatch, arguments, told):
    given = [str(run) if each == "RUN" else each for each in arguments]
    assert told in prove(monkeypatch, Prover(), *given, status=2).output


def check(monkeypatch, checker, *arguments, status=0):
    monkeypatch.setattr("verify.check_chunk", checker, raising=False)
    monkeypatch.setattr("verify.prepare_check", lambda *_: None, raising=False)
    monkeypatch.setattr("verify.audit", toy_problem.audit, raising=False)
    monkeypatch.setattr(compose.binding, "open_engine", lambda *_: InProcess(1))
    return invoke("prove", *arguments, "--check", status=status)


def test_checked_proofs_end_with_0_open_ones_with_4_and_refused_ones_with_1(run, monkeypatch):
    assert "not examined" in check(monkeypatch, Checker(), run, status=4).output
    prove(monkeypatch, Prover(), run)
    assert "checked: no 3-module topology" in check(monkeypatch, Checker(), run).output
    key = min(table(run))
    done = check(monkeypatch, Checker(refuses=key), run, "--json", status=1)
    (refused,) = (tree for tree in json.loads(done.stdout)["trees"] if tree["verdict"] == "refused")
    assert refused["key"] == key
    assert "box 2 of 3" in refused["fault"]


def test_only_what_the_same_command_can_prove_is_to_be_continued(run, monkeypatch):
    key, *_ = table(run)
    done = prove(monkeypatch, Prover(refuses=(key,)), run, "--topology", key, status=4)
    assert "some trees are still open\n" in done.stderr
    altered(run, ("DELETE FROM candidates WHERE key = ?", (list(table(run))[-1],)))
    done = prove(monkeypatch, Prover(), run, status=4)
    assert "1 not solved by `run`" in done.stdout
    assert "some trees are still open\n" in done.stderr


def test_nothing_is_claimed_after_a_refusal(run, monkeypatch):
    prove(monkeypatch, Prover(), run)
    (run / "best.json").write_text("{}")
    done = check(monkeypatch, Checker(), run, status=1)
    assert "refused: best.json is not the file that this run wrote" in done.stdout
    assert "J >= " not in done.stdout
    assert "better" not in done.stdout


@pytest.mark.parametrize("given", [("--time-limit", "5"), ("--from", "other")])
def test_a_check_takes_no_time_limit_and_no_other_run(run, monkeypatch, given):
    done = check(monkeypatch, Checker(), run, *given, status=2)
    assert f"{given[0]} cannot be combined with --check" in done.output


def test_proofs_may_come_from_another_run(run, tmp_path, monkeypatch):
    prove(monkeypatch, Prover(), run, "--gap", "0.01")
    toy_run(tmp_path / "other")
    prove(monkeypatch, prover := Prover(), tmp_path / "other", "--gap", "0.01", "--from", run)
    assert not prover.asked


# ---- A search that is followed by its proof: `search(..., prove=GAP)` and `run TASK --prove GAP`.


@pytest.fixture
def toy(monkeypatch, log):
    """The toy problem in place of solver and audit, and a prover that is a stand-in."""

    def proves(prover):
        monkeypatch.setattr(compose.binding, "BACKENDS", BACKENDS)
        monkeypatch.setattr("nlp.prepare", lambda *_: None)
        stand_in(monkeypatch, prover)

    return proves


def test_a_search_goes_on_to_its_proof(toy, tmp_path):
    toy(Prover())
    answer = search(toy_task(), out=tmp_path / "run", starts=2, prove=0.01)
    assert answer.proven
    (size,) = answer.sizes
    assert size.proven_gap == pytest.approx(0.01)
    assert size.statement == f"the best of all {size.candidates} candidates, proven to within 1.00 %"
    assert {row["proof"] for row in table(tmp_path / "run").values()} <= {"within", "excluded"}
    assert search(toy_task(), out=tmp_path / "run", starts=2).sizes == answer.sizes


def test_a_search_alone_proves_nothing(toy, tmp_path):
    toy(prover := Prover())
    answer = search(toy_task(), out=tmp_path / "run", starts=2)
    assert not answer.proven
    assert answer.sizes[0].proven_gap is None
    assert not prover.asked


def test_run_ends_with_4_if_trees_are_open_and_with_0_if_none_is(toy, tmp_path):
    (tmp_path / "task.toml").write_text(to_toml(toy_task()))
    words = ["run", tmp_path / "task.toml", "--starts", 2, "--prove", 0.01, "--out"]
    toy(Prover())
    key = json.loads(invoke(*words, tmp_path / "run", "--json").stdout)["best"]["key"]
    toy(Prover(refuses=(key,)))
    done = invoke(*words, tmp_path / "other", status=4)
    assert "1 open; nothing new is proven for the size" in done.output
    assert f"{key} is the best found of all" in done.output


@pytest.mark.parametrize(("gap", "told"), [(0.0, "0.0001 <= prove <= 0.5"), (0.7, "but got 0.7")])
def test_a_gap_beyond_the_limits_is_refused_before_the_search(toy, tmp_path, gap, told):
    toy(Prover())
    with pytest.raises(ValueError, match=told):
        search(toy_task(), out=tmp_path / "run", prove=gap)
    assert not (tmp_path / "run").exists()
    assert "--prove" in invoke("run", "push", "--prove", gap, status=2).output


def test_what_no_proof_can_be_of_is_refused_before_the_search(toy, tmp_path):
    toy(Prover())
    with pytest.raises(BadInput, match="modules: must be at most 12 for a proof, but got 13"):
        search(toy_task(13), out=tmp_path / "run", prove=0.01, strategy="optuna", trials=2)
    goals = older_task(toy_task().model_dump() | {"goals": {"clearance": [0.01, 0.02]}})
    with pytest.raises(BadInput, match="has goals: a proof needs a single objective"):
        search(goals, out=tmp_path / "run", prove=0.01)
    assert not (tmp_path / "run").exists()
