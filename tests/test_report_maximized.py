"""Words and charts of a run that maximises a quantity: the value, its bound, and the polytope around it."""

import json
from dataclasses import replace

import numpy as np
import pytest
from report_cases import Reader, design
from toy_problem import toy_row

from topo_search import read_task
from topo_search.cli.tables import _rows
from topo_search.compose import audit
from topo_search.model import Topology
from topo_search.model.largest_value import ability, objective_of
from topo_search.model.maximized import task_at
from topo_search.report.charts import progress
from topo_search.report.design_page import bound, design_page
from topo_search.report.headline import headline, ranking
from topo_search.report.page import render
from topo_search.report.polytope import polytopes
from topo_search.report.task_facts import facts
from topo_search.report.wording import near_tie_cells, near_tie_columns
from topo_search.study import SolveEvent
from topo_search.study.proofs import ProofState

HOVER = (
    'load_cases=[{name="hover",carries_weight=true}]',
    "module.joint_mass=0",
    'end_effector={rod="none",largest_reach=false}',
    "flight.defaults=false",
)


def strong(quantity, *settings):
    """A platform of three modules that holds a horizontal force in every direction, and its audit."""
    made = design(
        Topology.from_key("a300"),
        "push",
        *HOVER,
        f'search.maximize="{quantity}"',
        *settings,
        root_orientation_rad=(1.134, -0.425, 0.469),
        hinge_angles_rad=(-1.124, 1.124),
    )
    made = made.model_copy(update={"task": task_at(made.task, 2.4)})
    return made, audit(made)


@pytest.fixture(scope="module")
def disc():
    return strong("force_reserve")


def distances(chart):
    """Distances of the edges of a chart's outline from its centre, and the radius of its disc."""
    outline, circle = (np.column_stack([trace["x"], trace["y"]]) for trace in chart["data"][:2])
    along = np.diff(outline, axis=0)
    cross = outline[:-1, 0] * along[:, 1] - outline[:-1, 1] * along[:, 0]
    return np.abs(cross) / np.linalg.norm(along, axis=1), np.linalg.norm(circle, axis=1)


def test_the_disc_of_the_audit_touches_the_polytope(disc):
    made, found = disc
    ((_, caption, chart),) = polytopes([disc])["charts"]
    edges, radii = distances(chart)
    assert edges.min() == pytest.approx(found.flight.hover.horizontal_reserve_com_N, rel=1e-3)
    assert radii == pytest.approx(edges.min(), rel=1e-3)
    (x,), (y,) = chart["data"][2]["x"], chart["data"][2]["y"]
    assert np.hypot(x, y) == pytest.approx(edges.min(), rel=1e-3)
    assert made.topology.key in caption


@pytest.mark.parametrize(
    ("quantity", "settings", "field"),
    [
        ("force_reserve", ('flight.directions="all"',), "force_reserve_com_N"),
        ("force_reserve", ('flight.directions="all"', 'flight.at="tip"'), "force_reserve_N"),
        ("torque_reserve", (), "torque_reserve_Nm"),
    ],
)
def test_a_ball_is_drawn_in_three_planes(quantity, settings, field):
    made, found = strong(quantity, *settings)
    reserve = getattr(found.flight.hover, field)
    charts = [distances(chart) for *_, chart in polytopes([(made, found)])["charts"]]
    assert len(charts) == 3
    assert reserve > 0
    for edges, radii in charts:
        assert edges.min() >= reserve * (1 - 1e-3)
        assert radii == pytest.approx(reserve, abs=1e-4)


def test_no_polytope_without_a_maximised_reserve(disc):
    made, found = disc
    least = made.model_copy(update={"task": made.task.with_fields("search", maximize=None, reached=None)})
    assert polytopes([(least, found)]) is None


def test_the_page_of_a_design_gives_its_value_and_no_gap_of_effort(disc):
    made, found = disc
    tiles = {tile.name: tile for tile in headline(made, found, 0.1, "")}
    assert tiles["Largest force reserve"].figure == "2.4 N"
    assert "2.64 N" in tiles["Proven gap"].meaning
    page = Reader(render(design_page(made, found, "design.json")))
    assert ability(made.task, 2.4) in page.text
    assert json.loads(page.data["polytope-0-data"])["data"]
    assert "Proven gap" not in page.text


def test_the_bound_is_that_of_the_value(disc):
    made, _ = disc
    first, second, *_ = bound(0.0, 0.125, made.task, 2.7)
    assert "2.7 N" in first
    assert "12.5" in second
    assert "control effort" not in first


def test_the_ranking_and_the_tables_have_the_value(disc):
    objective = objective_of(disc[0].task)
    row = replace(
        toy_row("a300", objective=1.0, gap=0.125), value=2.40004, value_bound=2.7, reach=2.3, lower_bound=None
    )
    state = ProofState(2.60004, 0.08, "task", "within")
    shown = ranking([(row, state, None)], objective, proofs=True)["candidates"]
    cells = {name: cell for (name, *_), cell in zip(shown["columns"], shown["rows"][0], strict=True)}
    assert shown["merit"] == objective.column
    assert cells[objective.column] == 2.40004
    assert (cells["asked for more than [N]"], cells["proven bound [N]"], cells["J over bound"]) == (
        2.3,
        2.60004,
        None,
    )
    head, line = _rows((row,), objective)
    assert head.index(objective.column) < head.index("J [rad^4/s^4]")
    assert line.split()[1] == "2.4"
    worse = replace(row, value=2.4 * 0.99)
    assert near_tie_cells(worse, objective.difference(worse, replace(row, value=2.4)), 12)[1] == "-1.00 %"
    assert near_tie_columns(objective)[1] == "force reserve"


def test_the_progress_rises_to_the_bound(disc):
    objective = objective_of(disc[0].task)
    events = [SolveEvent(0.0, "a300", "feasible", 1.0, 1e-4, value) for value in (1.0, 2.5, 2.0)]
    chart = progress(events, objective, 2.7)
    points, incumbent, *_ = chart["data"]
    assert points["y"] == [1.0, 2.5, 2.0]
    assert incumbent["y"] == [1.0, 2.5, 2.5]
    assert [shape["y0"] for shape in chart["layout"]["shapes"]] == [2.7]
    assert chart["layout"]["yaxis"]["range"][1] > 2.7


@pytest.mark.parametrize("quantity", ["force_reserve", "torque_reserve", "load", "payload"])
def test_the_task_says_what_is_maximised(quantity):
    load = "load_cases=[{carries_weight=true,end_effector={force=[0.1,0.0,0.0]}}]"
    task = read_task("push", (load, *HOVER[1:], "modules=3", f'search.maximize="{quantity}"')).resolve(3)
    said = {name: text for _, rows in facts(task) for name, text in rows}
    assert said["the best platform"].startswith(ability(task))
    assert "1.25" in ability(task, 1.25)
