"""A search that is followed by its proof: `search(..., prove=GAP)` and `run TASK --prove GAP`."""

import json

import pytest
from click.testing import CliRunner
from test_study_proving import Prover, table
from toy_problem import BACKENDS, InProcess, toy_task

from topo_search import compose, search
from topo_search.cli import main
from topo_search.model import BadInput, Task
from topo_search.model.files import to_toml


@pytest.fixture
def toy(monkeypatch, log):
    """The toy problem in place of solver and audit, and a prover that is a stand-in."""

    def proves(prover):
        monkeypatch.setattr(compose.binding, "BACKENDS", BACKENDS)
        monkeypatch.setattr("nlp.prove_chunk", prover)
        for name in ("prepare", "prepare_proof"):
            monkeypatch.setattr(f"nlp.{name}", lambda *_: None)
        monkeypatch.setattr(compose.searching, "open_engine", lambda *_: InProcess(1))
        monkeypatch.setattr(compose.searching, "write_page", lambda folder: None)

    return proves


def test_a_search_goes_on_to_its_proof(toy, tmp_path):
    toy(Prover())
    answer = search(toy_task(), out=tmp_path / "run", starts=2, prove=0.01)
    assert answer.proven
    (size,) = answer.sizes
    assert size.proven_gap == pytest.approx(0.01)
    assert size.statement == f"the best of all {size.candidates} candidates, proven to within 1.00 %"
    assert {row["proof"] for row in table(tmp_path / "run").values()} <= {"within", "excluded"}
    again = search(toy_task(), out=tmp_path / "run", starts=2)
    assert again.sizes == answer.sizes


def test_a_search_alone_proves_nothing(toy, tmp_path):
    prover = Prover()
    toy(prover)
    answer = search(toy_task(), out=tmp_path / "run", starts=2)
    assert not answer.proven
    assert answer.sizes[0].proven_gap is None
    assert not prover.asked


def test_run_ends_with_4_if_trees_are_open_and_with_0_if_none_is(toy, tmp_path):
    (tmp_path / "task.toml").write_text(to_toml(toy_task()))
    words = ["run", str(tmp_path / "task.toml"), "--out", str(tmp_path / "run"), "--starts", "2", "--prove", "0.01"]
    toy(Prover())
    first = CliRunner().invoke(main, [*words, "--json"])
    assert first.exit_code == 0, first.output
    key = json.loads(first.stdout)["best"]["key"]
    toy(Prover(refuses=(key,)))
    words[words.index(str(tmp_path / "run"))] = str(tmp_path / "other")
    done = CliRunner().invoke(main, words)
    assert done.exit_code == 4, done.output
    assert "1 open; nothing new is proven" in done.output
    assert f"{key} is the best found of all" in done.output


@pytest.mark.parametrize(("gap", "told"), [(0.0, "0.0001 <= prove <= 0.5"), (0.7, "but got 0.7")])
def test_a_gap_beyond_the_limits_is_refused_before_the_search(toy, tmp_path, gap, told):
    toy(Prover())
    with pytest.raises(ValueError, match=told):
        search(toy_task(), out=tmp_path / "run", prove=gap)
    assert not (tmp_path / "run").exists()
    told = CliRunner().invoke(main, ["run", "push", "--prove", str(gap)])
    assert told.exit_code == 2
    assert "--prove" in told.output


def test_what_no_proof_can_be_of_is_refused_before_the_search(toy, tmp_path):
    toy(Prover())
    with pytest.raises(BadInput, match="modules: must be at most 12 for a proof, but got 13"):
        search(toy_task(13), out=tmp_path / "run", prove=0.01, strategy="optuna", trials=2)
    goals = Task.model_validate(toy_task().model_dump() | {"goals": {"clearance": [0.01, 0.02]}})
    with pytest.raises(BadInput, match="has goals: a proof needs a single objective"):
        search(goals, out=tmp_path / "run", prove=0.01)
    assert not (tmp_path / "run").exists()
