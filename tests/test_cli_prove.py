"""`topo-search prove`: what it prints, and its exit status; the branch and bound is a stand-in here."""

import json

import pytest
import toy_problem
from click.testing import CliRunner
from ledger_edit import forged
from processes import table
from test_study_checking import Checker
from test_study_proving import Prover
from toy_problem import InProcess, toy_run

from topo_search import compose
from topo_search.cli import main


@pytest.fixture
def run(tmp_path, log):
    toy_run(tmp_path / "run")
    return tmp_path / "run"


def prove(monkeypatch, prover, *arguments):
    monkeypatch.setattr("nlp.prove_chunk", prover)
    monkeypatch.setattr("nlp.prepare_proof", lambda *_: None)
    monkeypatch.setattr(compose.searching, "open_engine", lambda *_: InProcess(1))
    monkeypatch.setattr(compose.searching, "write_page", lambda folder: None)
    return CliRunner().invoke(main, ["prove", *map(str, arguments)])


def test_all_proven_ends_with_0_and_a_sentence(run, monkeypatch):
    done = prove(monkeypatch, Prover(), run, "--gap", "0.01")
    assert done.exit_code == 0, done.output
    assert f"{next(iter(table(run)))}: within, J >= " in done.output
    assert "proven by branch and bound: no 3-module topology is more than 1.00 % better" in done.output


def test_an_open_tree_ends_with_4_and_json_says_which(run, monkeypatch):
    key = list(table(run))[-1]
    done = prove(monkeypatch, Prover(refuses=(key,)), run, "--json")
    assert done.exit_code == 4, done.output
    told = json.loads(done.stdout)
    assert [row["key"] for row in told["candidates"] if row["proof"] == "open"] == [key]
    assert "run the same command" not in done.stderr


def test_one_tree_that_is_proven_ends_with_0_whatever_the_rest(run, monkeypatch):
    key = next(iter(table(run)))
    done = prove(monkeypatch, Prover(), run, "--topology", key)
    assert done.exit_code == 0, done.output
    assert [line for line in done.stdout.splitlines() if ": within" in line or "not examined, " in line]


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["nowhere"], "nowhere"),
        (["RUN", "--topology", "a999"], "has no candidate a999"),
        (["RUN", "--gap", "0"], "--gap"),
        (["RUN", "--dask-ca", "ca.pem"], "require --dask"),
    ],
)
def test_bad_input_ends_with_2(run, monkeypatch, arguments, told):
    given = [str(run) if each == "RUN" else each for each in arguments]
    done = prove(monkeypatch, Prover(), *given)
    assert done.exit_code == 2, done.output
    assert told in done.output


def check(monkeypatch, checker, *arguments):
    monkeypatch.setattr("verify.check_chunk", checker, raising=False)
    monkeypatch.setattr("verify.prepare_check", lambda *_: None, raising=False)
    monkeypatch.setattr("verify.audit", toy_problem.audit, raising=False)
    monkeypatch.setattr(compose.searching, "open_engine", lambda *_: InProcess(1))
    return CliRunner().invoke(main, ["prove", *map(str, arguments), "--check"])


def test_checked_proofs_end_with_0_open_ones_with_4_and_refused_ones_with_1(run, monkeypatch):
    done = check(monkeypatch, Checker(), run)
    assert done.exit_code == 4, done.output
    assert "not examined" in done.output
    prove(monkeypatch, Prover(), run)
    done = check(monkeypatch, Checker(), run)
    assert done.exit_code == 0, done.output
    assert "checked: no 3-module topology" in done.output
    key = min(table(run))
    done = check(monkeypatch, Checker(refuses=key), run, "--json")
    assert done.exit_code == 1, done.output
    (refused,) = (tree for tree in json.loads(done.stdout)["trees"] if tree["verdict"] == "refused")
    assert refused["key"] == key
    assert "box 2 of 3" in refused["fault"]


def test_only_what_the_same_command_can_prove_is_to_be_continued(run, monkeypatch):
    key, *_ = table(run)
    done = prove(monkeypatch, Prover(refuses=(key,)), run, "--topology", key)
    assert done.exit_code == 4
    assert "some trees are still open\n" in done.stderr
    forged(run, ("DELETE FROM candidates WHERE key = ?", (list(table(run))[-1],)))
    done = prove(monkeypatch, Prover(), run)
    assert done.exit_code == 4
    assert "1 not solved by `run`" in done.stdout
    assert "some trees are still open\n" in done.stderr


def test_nothing_is_claimed_after_a_refusal(run, monkeypatch):
    prove(monkeypatch, Prover(), run)
    (run / "best.json").write_text("{}")
    done = check(monkeypatch, Checker(), run)
    assert done.exit_code == 1
    assert "refused: best.json is not the file that this run wrote" in done.stdout
    assert "J >= " not in done.stdout
    assert "better" not in done.stdout


@pytest.mark.parametrize("given", [("--time-limit", "5"), ("--from", "other")])
def test_a_check_takes_no_time_limit_and_no_other_run(run, monkeypatch, given):
    done = check(monkeypatch, Checker(), run, *given)
    assert done.exit_code == 2
    assert f"{given[0]} cannot be combined with --check" in done.output


def test_proofs_may_come_from_another_run(run, tmp_path, monkeypatch):
    prove(monkeypatch, Prover(), run, "--gap", "0.01")
    toy_run(tmp_path / "other")
    prover = Prover()
    done = prove(monkeypatch, prover, tmp_path / "other", "--gap", "0.01", "--from", run)
    assert done.exit_code == 0, done.output
    assert not prover.asked
