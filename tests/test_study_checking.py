"""The check of a run's proofs: what it refuses, and what it says; the checker of chunks is a stand-in here."""

import dataclasses
import json
import zlib

import pytest
from ledger_edit import altered, rewritten
from processes import table
from test_study_proving import Prover, proven
from toy_problem import BACKENDS, InProcess, audit, infeasible, solve, toy_run
from wording import says

from topo_search.model import BadInput, CheckedChunk, Design, Proof
from topo_search.model.files import to_json
from topo_search.study import RunFolder, SilentObserver, check
from topo_search.study.tables import candidates


class Checker:
    """Holds every chunk, but those of a tree that it is told of."""

    def __init__(self, *, refuses=None):
        self.refuses, self.seen = refuses, []

    def __call__(self, task, topology, root_module, cut, chunk, problem):
        self.seen.append((topology.key, chunk.number, cut))
        fault = "box 2 of 3: no bound excludes it" if topology.key == self.refuses and chunk.number == 7 else None
        return CheckedChunk(number=chunk.number, fault=fault, boxes=len(chunk.record), halved=1)


def checked(path, checker=None, **options):
    given = {"key": None, "engine": InProcess(1), "observer": SilentObserver(), **options}
    return check(path, checker or Checker(), audit, **given)


@pytest.fixture
def run(tmp_path, log):
    toy_run(tmp_path / "run")
    proven(tmp_path / "run", Prover())
    return tmp_path / "run"


def test_proofs_that_hold_are_checked_and_nothing_is_written(run):
    before = {path: path.read_bytes() for path in run.rglob("*") if path.is_file()}
    checker = Checker()
    found = checked(run, checker)
    assert not found.refused
    assert found.settled
    assert {tree.verdict for tree in found.trees} == {"checked"}
    assert len(checker.seen) == 64 * len(table(run))
    assert all(tree.boxes == 3 * 64 and tree.halved == 64 for tree in found.trees)
    (sentence,) = found.sentences
    assert says(sentence, "checked: no 3-module topology", "1.00 %")
    assert before == {path: path.read_bytes() for path in run.rglob("*") if path.is_file()}


def test_what_compiles_is_called_before_the_first_chunk(run):
    checker, prepared = Checker(), []

    def prepare(task):
        assert not checker.seen
        prepared.append(task.n)

    checked(run, checker, prepare=prepare)
    assert prepared == [3]


def test_a_chunk_that_does_not_hold_is_named_with_its_box(run):
    key = list(table(run))[-1]
    found = checked(run, Checker(refuses=key))
    assert found.refused
    (tree,) = (tree for tree in found.trees if tree.verdict == "refused")
    assert (tree.key, tree.fault) == (key, "chunk 7: box 2 of 3: no bound excludes it")
    assert found.sentences[0].endswith("1 refused")


def edited(path, **changes):
    rewrite(path, json.dumps(json.loads(path.read_text()) | changes))


def rewrite(path, content):
    rewritten(path.parents[1], f"{path.parent.name}/{path.name}", content)


def test_the_proof_of_another_tree_or_task_is_refused(run):
    first, second, *_ = sorted((run / "proof").iterdir())
    one, other = first.read_bytes(), second.read_bytes()
    rewrite(first, other)
    rewrite(second, one)
    told = {tree.key: tree.fault for tree in checked(run).trees}
    assert told[first.name] == f"proof/{first.name} is the proof of another tree, {second.name}"
    rewrite(first, one)
    edited(first, task=json.loads(one)["task"] | {"gravity": 9.0})
    told = {tree.key: tree.fault for tree in checked(run).trees}
    assert told[first.name] == f"proof/{first.name} is about another task"


@pytest.mark.parametrize(
    ("change", "why"),
    [({"version": 2}, "version"), ({"format": "other"}, "format"), ({"cut": "low"}, "cut"), ({"more": 1}, "more")],
)
def test_a_proof_that_cannot_be_read_is_refused(run, change, why):
    file = min((run / "proof").iterdir())
    edited(file, **change)
    found = checked(run)
    (tree,) = (tree for tree in found.trees if tree.verdict == "refused")
    assert tree.key == file.name
    assert why in tree.fault


def test_a_proof_that_is_cut_off_or_has_a_chunk_twice_or_too_few_is_not_checked(run):
    file = min((run / "proof").iterdir())
    text = file.read_text()
    rewrite(file, text[: len(text) // 2])
    assert checked(run).refused
    chunks = json.loads(text)["chunks"]
    rewrite(file, text)
    edited(file, chunks=[*chunks, chunks[0]])
    assert f"proof/{file.name} has a chunk twice" in {tree.fault for tree in checked(run).trees}
    edited(file, chunks=chunks[:-1])
    found = checked(run)
    assert not found.refused
    assert not found.settled
    assert "1 open" in found.sentences[0]


def test_one_tree_alone_and_a_tree_without_a_proof(run):
    key = min(table(run))
    found = checked(run, key=key)
    assert [tree.key for tree in found.trees] == [key]
    assert not found.sentences
    (run / "proof" / key).unlink()
    assert [tree.verdict for tree in checked(run, key=key).trees] == ["not examined"]
    with pytest.raises(BadInput, match="has no candidate a999"):
        checked(run, key="a999")


@pytest.mark.parametrize("closes", [True, False])
def test_the_proof_of_a_tree_that_is_impossible_is_checked_like_any_other(tmp_path, log, closes):
    def solved(job):
        return infeasible(job.topology, "impossible") if job.topology.key == "a300" else solve(job)

    path = tmp_path / "run"
    toy_run(path, backends=dataclasses.replace(BACKENDS, solve=solved))
    prover = Prover(refuses=() if closes else ("a300",))
    answer = proven(path, prover)
    assert prover.asked[-1][0] == "a300"
    assert table(path)["a300"]["proof"] == "impossible"
    assert "1 impossible" in answer.sizes[0].proven
    found = checked(path)
    assert found.settled
    assert {tree.key: tree.verdict for tree in found.trees}["a300"] == ("checked" if closes else "impossible")
    assert ("1 recorded as impossible, which is not checked" in found.sentences[0]) is not closes


def test_the_best_design_is_audited_again(run, monkeypatch):
    best = min(table(run).values(), key=lambda row: float(row["objective"]))["key"]
    monkeypatch.setenv("TOY_VIOLATED", best)
    found = checked(run)
    assert found.refused
    assert found.faults == [f"{best}: the audit of the best design is violated"]


def test_a_proof_that_differs_from_what_was_written_is_refused_whatever_it_says(run):
    file = min((run / "proof").iterdir())
    text = file.read_bytes()
    proof = json.loads(text)
    emptied = [{**chunk, "packed": "", "boxes": 0} for chunk in proof["chunks"]]
    changes = [{"gap": 0.5}, {"cut": proof["cut"] * 0.5}, {"cut": proof["cut"] * 2}, {"chunks": emptied}]
    for content in (text + b"\n", b"", *(json.dumps(proof | change).encode() for change in changes)):
        file.write_bytes(content)
        (tree,) = (tree for tree in checked(run).trees if tree.verdict == "refused")
        assert says(tree.fault, f"proof/{file.name} is not the file that this run wrote")
        for use in (toy_run, lambda path: proven(path, Prover())):
            with pytest.raises(BadInput, match=f"proof/{file.name}: is not the file that this run wrote"):
                use(run)
        assert file.read_bytes() == content
    file.unlink()
    proven(run, Prover())
    assert file.read_bytes() == text


def test_a_bound_above_a_known_design_is_refused(run):
    file = min((run / "proof").iterdir())
    edited(file, cut=float(table(run)[file.name]["objective"]) * 1.001)
    for use in (toy_run, lambda path: proven(path, Prover()), candidates):
        with pytest.raises(BadInput, match=rf"{file.name}: proves J >= .* an audited design of"):
            use(run)


@pytest.mark.parametrize("name", ["best.json", "candidates.csv", "designs/a300.json", "task.toml"])
def test_a_check_refuses_files_that_the_run_did_not_write(run, name):
    path = run / name
    path.write_bytes(path.read_bytes().replace(b"toy", b"toy", 1) + b"\n")
    found = checked(run)
    assert found.faults == [f"{name} is not the file that this run wrote"]
    assert found.refused
    assert found.sentences == ["4 of 4 trees checked"]
    assert all(tree.bound is None for tree in found.trees)


@pytest.mark.parametrize("other", ["a999", "a030", "aff"])
def test_a_check_looks_which_trees_there_are(run, other):
    key = list(table(run))[-1]
    proof = json.loads((run / "proof" / key).read_text())
    (run / "proof" / key).unlink()
    other = other.ljust(len(key), "0")
    altered(run, ("UPDATE candidates SET key = ? WHERE key = ?", (other, key)))
    with RunFolder.load(run, writes=True) as folder:
        folder.write_file(f"proof/{other}", to_json(Proof.model_validate(proof | {"topology_key": other})))
    found = checked(run)
    assert [tree.fault for tree in found.trees if tree.key == other] == ["is no candidate of this run"]
    assert "checked:" not in found.sentences[0]
    assert found.refused


def test_a_replaced_best_design_is_refused(run):
    best, *_ = table(run)
    with RunFolder.load(run) as folder:
        text = folder.design_text(next(row for row in folder.ledger.ranking(3) if row.key == best))
    design = Design.model_validate_json(text)
    looser = design.model_copy(update={"task": design.task.model_copy(update={"gravity": 1.0})})
    for other in (looser, design.model_copy(update={"objective": design.objective * 0.9})):
        replaced = to_json(other).encode()
        altered(
            run,
            ("UPDATE texts SET result = ? WHERE key = ?", (replaced, best)),
            ("UPDATE candidates SET result_checksum = ? WHERE key = ?", (zlib.crc32(replaced), best)),
        )
        (fault,) = checked(run).faults
        assert says(fault, best, "of another tree, task or objective")


def test_what_a_record_says_beside_its_cut_proves_nothing(run):
    """With its digest right again: the claim is that of the cut, which is checked."""
    file = min((run / "proof").iterdir())
    proof = json.loads(file.read_text())
    (sentence,) = checked(run).sentences
    chunks = [chunk | {"boxes": 7, "stuck": [[0.0], [1.0]]} for chunk in proof["chunks"]]
    for change in ({"aim": "within"}, {"gap": 0.5}, {"root_module": 1}, {"chunks": chunks}):
        rewrite(file, json.dumps(proof | change))
        assert checked(run).sentences == [sentence]


def test_candidates_that_are_not_solved_yet_leave_a_check_open(run):
    key = list(table(run))[-1]
    altered(run, ("DELETE FROM candidates WHERE key = ?", (key,)))
    (run / "proof" / key).unlink()
    found = checked(run)
    assert found.sentences == ["3 of 4 trees checked, 1 not examined"]
    assert not found.settled
    assert checked(run, key=next(iter(table(run)))).settled
