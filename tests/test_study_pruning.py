import math

import pytest
import toy_problem
from processes import table
from toy_problem import solved_keys, toy_run

from topo_search.engine import ExhaustiveSearch
from topo_search.model import BadInput
from topo_search.study import RunFolder


def test_a_design_that_meets_the_bound_spares_the_rest_which_is_counted(tmp_path, monkeypatch, log):
    keys = sorted(table_of_all(tmp_path))
    ahead = (
        ExhaustiveSearch.ahead + 3
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


def test_nothing_is_pruned_while_the_bound_leaves_room(tmp_path):
    pruned, whole = (toy_run(tmp_path / str(prune), modules=4, prune=prune) for prune in (True, False))
    assert pruned.sizes == whole.sizes
    gap = math.ceil(1e4 * (1 - toy_problem.BOUND / whole.best.objective)) / 100  # what is proven is rounded up
    assert whole.sizes[0].statement == (
        f"the best found of all 14 candidates; proven: no 4-module topology is more than {gap:.2f} % better"
    )


def test_a_folder_holds_either_kind_of_run(tmp_path):
    toy_run(tmp_path / "run", prune=True)
    with pytest.raises(BadInput, match="holds a run with prune True, not False"):
        toy_run(tmp_path / "run")
