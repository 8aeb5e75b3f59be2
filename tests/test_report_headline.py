"""The headline of the page: each tile says what the design, its audit or its row says, rounded to the safe side."""

import re
from dataclasses import replace

import numpy as np
import pytest
from report_cases import Reader, design, toy_page
from toy_problem import toy_row, toy_run

from topo_search.compose import audit
from topo_search.model import Audit, Design, Topology
from topo_search.report import headline as module
from topo_search.report.design_page import design_page
from topo_search.report.headline import Compared, cards, headline, rows_with_cards
from topo_search.report.page import render
from topo_search.report.wording import closest, fragile_margins
from topo_search.study import RunFolder


@pytest.fixture(scope="module")
def audited() -> tuple[Design, Audit]:
    made = design(Topology.from_key("af0000"), "push")
    return made, audit(made)


def told(made: Design, found: Audit | None, gap: float | None = None) -> dict[str, tuple[str, str]]:
    return {tile.name: (tile.figure, tile.meaning) for tile in headline(made, found, gap, "28 candidates solved")}


def test_throttle_is_input_over_the_largest_input(audited: tuple[Design, Audit]) -> None:
    made, found = audited
    u_max = 2.5 * 0.24 * 9.81 / (4 * 3.87e-7)
    u = np.array(made.rotor_speeds_squared) / u_max
    peak, mean = told(made, found)["Peak throttle"]
    assert 0 <= float(peak.removesuffix(" %")) - 100 * u.max() < 0.11
    assert f"mean {100 * u.mean():.3g} %" in mean


def test_the_least_clearance_is_the_least_of_all_pairs(audited: tuple[Design, Audit]) -> None:
    made, found = audited
    least = min(pair.analytic_m for pair in found.pairs)
    nearest = closest(found)
    assert nearest.analytic_m == least < 0
    figure, meaning = told(made, found)["Smallest clearance"]
    assert meaning == nearest.name
    size, unit = figure.replace("−", "-").split()
    assert float(size) * {"mm": 1e-3, "cm": 1e-2, "m": 1}[unit] <= least
    (status,) = (tile.status for tile in headline(made, found, None, "") if tile.name == "Smallest clearance")
    assert status == "violated"


@pytest.mark.parametrize(("metres", "degrees", "words"), [(0.00017, 0.0079, 2), (0.00099, 0.2, 1), (0.002, 0.1, 0)])
def test_a_clear_design_with_hardly_any_margin_is_amber(audited, metres, degrees, words):
    made, found = audited
    pair = found.pairs[0].model_copy(update={"status": "clear", "analytic_m": metres, "lower_m": metres})
    flight = found.flight.model_copy(update={"hinge_tolerance_deg": degrees})
    clear = found.model_copy(update={"verdict": "clear", "pairs": (pair,), "flight": flight})
    told = {tile.name: tile for tile in headline(made, clear, None, "")}
    assert told["Smallest clearance"].status == ("fragile" if metres < 0.001 else "")
    assert told["Hinge tolerance"].status == ("fragile" if degrees < 0.1 else "")
    assert len(fragile_margins(clear)) == words
    text = render(design_page(made, clear, "mine.json"))
    assert ('<span class="verdict fragile">audit: clear' in text) == (words > 0)
    assert all(f in text for f in fragile_margins(clear))
    assert fragile_margins(found) == ()


def test_tiles_are_of_what_is_told_and_asked_for(audited: tuple[Design, Audit]) -> None:
    made, found = audited
    assert told(*audited, 0.088901)["Proven gap"][0] == "8.90 %"
    assert "Proven gap" not in told(*audited)
    assert set(told(made, None)) == {"Modules", "Peak throttle"}
    assert "Rotor failures" not in told(made, found.model_copy(update={"flight": None}))
    assert made.task.end_effector.rod == "none"
    assert found.flight.rod_length_m is not None  # the audit reports it all the same
    assert "Rod" not in told(made, found)
    asking = design(Topology.from_key("af0000"), "push", "end_effector.rod=straight")
    flight = found.flight.model_copy(update={"rod_length_m": None})
    assert told(asking, found.model_copy(update={"flight": flight}))["Rod"][0] == "none"


def test_reserves_are_rounded_down(audited: tuple[Design, Audit]) -> None:
    made, found = audited
    hover = found.flight.hover.model_copy(
        update={"possible": True, "horizontal_reserve_N": 1.2999, "horizontal_weakest": (0.0, -1.0, 0.0)}
    )
    for changed, expected in (
        (hover, ("1.29 N", "at the tip in hover, weakest towards -y")),
        (hover.model_copy(update={"possible": False}), ("none", "cannot hover")),
        (hover.model_copy(update={"possible": None}), ("none", "hover is undecided")),
    ):
        flight = found.flight.model_copy(update={"cases": (changed, *found.flight.cases[1:])})
        assert told(made, found.model_copy(update={"flight": flight}))["Side force"] == expected


def test_the_air_is_told_at_the_tip_and_over_the_regions(audited: tuple[Design, Audit]) -> None:
    made = design(Topology.from_key("af0000"), "push-two-paths")
    found = audit(made)
    tip = max(case.tip_m_s for case in found.air.cases)
    over = max(region.speed_at_most_m_s for case in found.air.cases for region in case.regions)
    figure, meaning = told(made, found)["Air at the tip"]
    assert 0 <= float(figure.removesuffix(" m/s")) - tip < 0.01 * tip
    most = float(meaning.removeprefix("in the regions at most ").removesuffix(" m/s, by the jet model"))
    assert 0 <= most - over < 0.01 * over
    for speed, limit, status in ((2.9, None, ""), (3.1, None, "fragile"), (3.1, 4.0, "")):  # fragile: amber
        region = found.air.cases[0].regions[0].model_copy(update={"speed_at_most_m_s": speed, "limit_m_s": limit})
        cases = [case.model_copy(update={"regions": (region,)}) for case in found.air.cases]
        changed = found.model_copy(update={"air": found.air.model_copy(update={"cases": tuple(cases)})})
        (tile,) = (tile for tile in module.headline(made, changed, None, "") if tile.name == "Air at the tip")
        assert tile.status == status
    assert told(*audited)["Air at the tip"][1] == "by the jet model"
    assert "Air at the tip" not in told(made, found.model_copy(update={"air": None}))


# ---- Which designs of a run the page shows beside the winner, and how much they may take.


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
    rows = rows_with_cards(answer, answer.best)
    assert rows[0] == answer.best
    assert [row.modules for row in rows].count(4) == 3
    assert len({row.key for row in rows}) == len(rows)


def test_cards_stop_where_the_page_would_get_large(monkeypatch):
    found = [Compared(key, design(Topology.from_key(key)), None, 0.1) for key in ("af0000", "a70010", "a31040")]
    best = toy_row("af0000", objective=1.0, gap=0.1)
    assert [card["key"] for card in cards(found, best)] == ["af0000", "a70010", "a31040"]
    monkeypatch.setattr(module, "MAX_CARD_CHARACTERS", 20_000)
    assert next(cards(found, best))["key"] == "af0000"
    assert len(list(cards(found, best))) < 3


def test_a_design_that_cannot_be_drawn_has_no_card():
    far = design(Topology.from_key("a70010"), end_effector_m=[1e200, 0.0, 0.0])
    near = design(Topology.from_key("af0000"))
    best = toy_row("af0000", objective=1.0, gap=0.1)
    found = [Compared("af0000", near, None, 0.1), Compared("a70010", far, None, 0.1)]
    assert [card["key"] for card in cards(found, best)] == ["af0000"]


@pytest.mark.parametrize(("objective", "told"), [(1.0, "lowest found"), (1.0049, "+0.49 %"), (1.1, "+10.00 %")])
def test_effort_is_told_over_that_of_the_best(objective, told):
    best = replace(toy_row("af0000", objective=1.0, gap=0.1), modules=5)
    key = "af0000" if objective == 1.0 else "a70010"
    made = design(Topology.from_key(key)).model_copy(update={"objective": objective})
    (card,) = cards([Compared(key, made, None, 0.1)], best)
    figures = {tile.name: tile.figure for tile in card["figures"]}
    assert (figures["Control effort"], figures["Audit"]) == (told, "none")
