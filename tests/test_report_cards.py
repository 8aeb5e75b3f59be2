"""Which designs of a run the page shows beside the winner, and how much they may take."""

import re
from dataclasses import replace

import pytest
from report_cases import Reader, design, toy_page
from toy_problem import toy_row, toy_run

from topo_search.model import Topology
from topo_search.report import headline as module
from topo_search.report.headline import Compared, cards, rows_to_show
from topo_search.study import RunFolder


def keys(text: str) -> list[str]:
    return re.findall(r'<template id="card-(\w+)">', text)


def test_the_best_ten_have_a_card_the_winner_first(tmp_path):
    text = toy_page(tmp_path / "run", modules=4, starts=4)
    with RunFolder.load(tmp_path / "run") as folder:
        ranked = [row.key for row in folder.ledger.ranking(4)]
    assert len(ranked) > 10
    assert keys(text) == ranked[:10]
    assert len(Reader(text).ids) == len({*Reader(text).ids})


def test_other_sizes_have_their_best_three(tmp_path):
    answer = toy_run(tmp_path / "run", modules=(3, 4), starts=4)
    assert answer.best is not None
    rows = rows_to_show(answer, answer.best)
    assert rows[0] == answer.best
    assert [row.modules for row in rows].count(4) == 3
    assert len({row.key for row in rows}) == len(rows)


def test_a_run_without_a_design_has_no_cards(tmp_path, monkeypatch):
    monkeypatch.setenv("TOY_NONE", "*")
    assert keys(toy_page(tmp_path / "run")) == []


def test_cards_stop_where_the_page_would_get_large(monkeypatch):
    found = [Compared(key, design(Topology.from_key(key)), None, 0.1) for key in ("af0000", "a70010", "a31040")]
    best = toy_row("af0000", objective=1.0, gap=0.1)
    assert [card["key"] for card in cards(found, best)] == ["af0000", "a70010", "a31040"]
    monkeypatch.setattr(module, "LARGEST", 20_000)
    assert next(cards(found, best))["key"] == "af0000"
    assert len(list(cards(found, best))) < 3


def test_a_design_that_cannot_be_drawn_has_no_card():
    far = design(Topology.from_key("a70010"), end_effector_m=[1e200, 0.0, 0.0])
    near = design(Topology.from_key("af0000"))
    best = toy_row("af0000", objective=1.0, gap=0.1)
    found = [Compared("af0000", near, None, 0.1), Compared("a70010", far, None, 0.1)]
    assert [card["key"] for card in cards(found, best)] == ["af0000"]


@pytest.mark.parametrize(("objective", "told"), [(1.0, "least found"), (1.0049, "+0.49 %"), (1.1, "+10.00 %")])
def test_effort_is_told_over_that_of_the_best(objective, told):
    best = replace(toy_row("af0000", objective=1.0, gap=0.1), modules=5)
    key = "af0000" if objective == 1.0 else "a70010"
    made = design(Topology.from_key(key)).model_copy(update={"objective": objective})
    (card,) = cards([Compared(key, made, None, 0.1)], best)
    figures = {tile.name: tile.figure for tile in card["figures"]}
    assert (figures["Control effort"], figures["Audit"]) == (told, "none")
