import csv
import tempfile
from dataclasses import astuple
from pathlib import Path

import pandas as pd
import pytest

from topo_search.cli.experiment import NAMES
from topo_search.experiments import Settings, experiment, results
from topo_search.experiments.comparison import tree_of
from topo_search.experiments.measured import COLUMNS, Measured
from topo_search.experiments.scaling import growth, slowdown
from topo_search.topologies import count

SOLVED = ((10, "a300", 1.0), (10, "a500", 2.0), (20, "a300", 5.0))
"""Size, topology and seconds."""


def frame(*rows):
    """Rows as they are read from a file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "results.csv"
        with path.open("w", newline="") as stream:
            csv.writer(stream).writerows([COLUMNS, *map(astuple, rows)])
        return results(path)


def measured(n, *, status="feasible", task="ten-wrenches", variant="airflow", key="a300", **values):
    clear = {"verdict": "clear"} if status == "feasible" else {}
    return Measured(
        variant=variant,
        task=task,
        distance_m=values.pop("distance_m", 0.3),
        n=n,
        key=key,
        task_seed=0,
        status=status,
        **{**clear, **values},
    )


def test_growth_is_the_exponent_of_the_power_law():
    rows = frame(
        *(measured(n, solve_s=2e-4 * n**2) for n in (10, 20, 40, 100)),
        *(measured(n, solve_s=1e-3 * n, build_s=1e-3 * n, task="ten-wrenches-local") for n in (10, 20, 40)),
        measured(10, solve_s=5.0, task="ten-wrenches-directional"),
        measured(60, status="infeasible", solve_s=500.0),
    )
    fits = experiment("scaling").findings(rows)
    assert "the time to a design grows as n^1.0 to n^2.0, " in fits[1]
    table = growth(rows).set_index("task")
    assert table.loc["ten-wrenches", "exponent"] == pytest.approx(2.0)
    assert table.loc["ten-wrenches", "seconds_at_100"] == pytest.approx(2.0)
    assert table.loc["ten-wrenches-local", "exponent"] == pytest.approx(1.0)
    assert table.loc["ten-wrenches-local", "designs"] == 3
    assert "ten-wrenches-directional" not in table.index


def test_scaling_counts_all_topologies_but_times_designs_alone():
    rows = frame(
        measured(10, solve_s=1.0, starts=1, iterations=10, peak_mb=200.0, gap=0.1),
        measured(10, solve_s=3.0, starts=2, iterations=30, peak_mb=300.0, gap=0.3, verdict="violated"),
        measured(10, solve_s=99.0, starts=5, iterations=99, peak_mb=400.0, status="infeasible"),
        measured(10, status="failed"),
    )
    (row,) = experiment("scaling").summary(rows).to_dict(orient="records")
    assert row["trees"] == 4
    assert row["share_solved"] == 0.5
    assert row["share_clear"] == 0.25
    assert (row["seconds_median"], row["seconds_max"], row["iterations_median"]) == (2.0, 3.0, 20.0)
    assert row["peak_mb"] == 400.0
    assert row["gap_median"] == pytest.approx(0.2)
    assert experiment("scaling").findings(rows)[0] == (
        "topo-search, 0.30 m: 2 of 4 problems have a design, 1 of them with a clear audit; with 10 modules 2 of 4."
    )


def test_another_method_is_compared_on_the_problems_that_both_solve():
    rows = frame(
        *(measured(n, key=key, solve_s=seconds, peak_mb=200.0) for n, key, seconds in SOLVED),
        measured(10, key="a600", status="infeasible", solve_s=9.0, peak_mb=250.0),
        *(
            measured(
                n, key=key, method="direct", solve_s=4 * seconds, build_s=6 * seconds, peak_mb=500.0, verdict=None
            )
            for n, key, seconds in SOLVED[1:]
        ),
        measured(10, key="a600", method="direct", solve_s=1.0, build_s=1.0, peak_mb=500.0, verdict=None),
    )
    (ten, twenty) = slowdown(rows).to_dict(orient="records")
    assert (ten["method"], ten["n"], ten["problems"], twenty["n"], twenty["problems"]) == ("direct", 10, 1, 20, 1)
    assert ten["times_median"] == twenty["times_median"] == pytest.approx(10.0)
    assert ten["memory_median"] == pytest.approx(2.5)
    told = experiment("scaling").findings(rows)
    assert told[0].startswith("topo-search, 0.30 m: 3 of 4 problems have a design, 3 of them with a clear audit; ")
    assert "direct, 0.30 m: 3 of 3 problems have a design; with 20 modules 1 of 1." in told
    assert told[-1] == (
        "direct, 0.30 m: on the 2 problems that both solve it takes a multiple of the seconds of topo-search, in "
        "the median 10.0 with 10 modules, 10.0 with 20 modules; with 20 it holds 2.5 times the memory."
    )
    (upper, _) = experiment("scaling").figure(rows).axes
    assert [text.get_text() for text in upper.get_legend().get_texts()] == ["ten-wrenches", "ten-wrenches, direct"]


def test_exposure_settings_are_of_a_similar_range_up_to_a_factor_of_three():
    for factor, word in ((2.9, "is confirmed"), (3.1, "is not confirmed")):
        rows = frame(
            *(measured(n, solve_s=1.0) for n in (10, 20)),
            *(measured(n, solve_s=factor, task="ten-wrenches-local") for n in (10, 20)),
        )
        assert f"differ by a factor of {factor} in the median over sizes, {factor} at most" in " ".join(
            experiment("scaling").findings(rows)
        )
        assert word in " ".join(experiment("scaling").findings(rows))


def test_a_size_without_designs_stands_in_the_table_without_times():
    rows = frame(measured(10, solve_s=1.0), measured(20, status="infeasible", solve_s=9.0))
    table = experiment("scaling").summary(rows).set_index("n")
    assert table.loc[20, "share_solved"] == 0.0
    assert pd.isna(table.loc[20, "seconds_median"])
    experiment("scaling").figure(rows).canvas.draw_idle()


def test_the_ablation_s_metrics_and_findings():
    def overlap(n, pairs, cluster, deepest):
        return measured(
            n,
            variant="separation",
            colliding_pairs=pairs,
            largest_cluster=cluster,
            deepest_percent=deepest,
            median_percent=deepest / 2,
        )

    rows = frame(
        overlap(10, 0, 0, 0.0),
        overlap(10, 4, 5, 96.0),
        overlap(10, 6, 6, 80.0),
        overlap(20, 9, 18, 99.0),
        measured(20, variant="separation", status="infeasible"),
    )
    ten, twenty = experiment("ablation").summary(rows).to_dict(orient="records")
    assert (ten["designs"], ten["pairs_median"], ten["cluster_median"]) == (3, 4, 5)
    assert ten["share_colliding"] == pytest.approx(2 / 3)
    assert ten["share_deepest_reached"] == pytest.approx(1 / 3)
    assert ten["deepest_median_percent"] == 80.0
    assert (twenty["trees"], twenty["designs"], twenty["cluster_share_median"]) == (2, 1, 0.9)
    told = experiment("ablation").findings(rows)
    assert told == [
        "75% of 4 designs have overlapping airflow.",
        "The deepest overlap reaches 95 % of the deepest possible in 50% of the designs; its median is 88 %, its "
        "least 0 %. That the deepest possible is often reached, as the paper finds, is confirmed.",
        "The largest cluster holds 55% of the modules in the median; it is about half (40% to 60%) of them in 50% "
        "of the designs, more in 25%. That clusters of about half of the modules, or more, are frequent, as the "
        "paper finds, is confirmed.",
        "The median number of colliding pairs goes from 4 with 10 modules to 9 with 20: it grows as n^0.9. That "
        "the number grows with n, as the paper finds, is confirmed.",
    ]


def push(key, variant, objective=None, gap=None):
    status = "infeasible" if objective is None else "feasible"
    return measured(
        5, task="push", key=key, variant=variant, status=status, objective=objective, gap=gap, offset_m=0.2
    )


def test_a_comparison_is_made_tree_by_tree():
    rows = frame(
        push("a300", "airflow only", 10.0, 0.1),
        push("a300", "body clearance", 11.0, 0.2),
        push("a500", "airflow only", 8.0, 0.05),
        push("a500", "body clearance"),
        push("a600", "airflow only"),
        push("a600", "body clearance"),
        push("aa00", "airflow only", 9.0, 0.3),
        push("aa00", "body clearance", 9.0, 0.3),
    )
    reference, other = experiment("body").summary(rows).to_dict(orient="records")
    assert (reference["variant"], other["variant"]) == ("airflow only", "body clearance")
    assert (reference["trees_solved"], other["trees_solved"], other["trees"]) == (3, 2, 4)
    assert (reference["effort_ratio_median"], reference["best_ratio"]) == (1.0, 1.0)
    assert other["trees_compared"] == 2
    assert other["effort_ratio_median"] == pytest.approx(1.05)
    assert other["effort_ratio_max"] == pytest.approx(1.1)
    assert other["best_ratio"] == pytest.approx(9 / 8)
    assert (reference["best_gap"], other["best_gap"]) == (0.05, 0.2)
    assert experiment("body").findings(rows) == [
        "push, 5 modules at 0.30 m: body clearance: 2 of 4 trees have a design, airflow only: 3; where both have "
        "one, body clearance takes +5.0% effort in the median (+10.0% at most); its best design takes +12.5%, gap "
        "20.0% instead of 5.0%."
    ]


def test_with_the_paper_s_root_a_tree_has_the_effort_of_its_best_root():
    cells = experiment("root").cells(Settings((("push", (4,)),), (50, 50), 1))
    free = [cell.key for cell in cells if cell.variant.name == "free root"]
    rooted = [cell.key for cell in cells if cell.variant.name == "paper root"]
    assert len(free) == len(set(free)) == count(4) == 14
    assert len(rooted) == len(set(rooted)) == count(4, symmetry="none", root="paper") == 88
    assert {tree_of(key) for key in rooted} == set(free)
    assert {cell.resolve().search.root for cell in cells if cell.key in rooted and cell.key not in free} == {
        "paper"
    }

    roots = [key for key in rooted if tree_of(key) == free[3]]
    efforts = [20.0, 13.0, *[None] * (len(roots) - 2)]
    rows = frame(
        push(free[3], "free root", 10.0, 0.1),
        push(free[4], "free root"),
        *(push(key, "paper root", effort, 0.5) for key, effort in zip(roots, efforts, strict=True)),
    )
    free_root, paper_root = experiment("root").summary(rows).to_dict(orient="records")
    assert (free_root["topologies"], free_root["trees"], free_root["trees_solved"]) == (2, 2, 1)
    assert (paper_root["topologies"], paper_root["trees"], paper_root["trees_solved"]) == (len(roots), 1, 1)
    assert paper_root["share_solved"] == pytest.approx(2 / len(roots))
    assert paper_root["effort_ratio_median"] == pytest.approx(1.3)


def test_roots_are_those_of_the_sampled_trees_alone():
    cells = experiment("root").cells(Settings((("push", (5,)),), (3, 3), 1))
    free = {cell.key for cell in cells if cell.variant.name == "free root"}
    assert len(free) == 3
    assert {tree_of(cell.key) for cell in cells if cell.variant.name == "paper root"} == free


def test_at_the_centre_of_mass_the_task_says_so():
    cells = experiment("placement").cells(Settings((("push", (3,)),), (1, 1), 1))
    asked = [cell.resolve().end_effector for cell in cells]
    assert [(one.position, one.exclusion) for one in asked] == [("free", True), ("com", True), ("com", False)]


@pytest.mark.parametrize("name", NAMES)
def test_an_experiment_without_any_design_says_so_and_can_be_drawn(name):
    variants = {cell.variant.name for cell in experiment(name).cells(experiment(name).small)}
    rows = frame(
        *(measured(3, status="infeasible", variant=variant) for variant in variants),
        *(measured(4, status="failed", key="a3040", variant=variant) for variant in variants),
    )
    asked = experiment(name)
    assert asked.findings(rows)
    assert len(asked.summary(rows)) == 2 * len(variants)
    asked.figure(rows)


@pytest.mark.parametrize("name", NAMES)
def test_figures_have_titles_axes_and_units(name):
    overlaps = {"colliding_pairs": 1, "largest_cluster": 2, "deepest_percent": 50.0, "median_percent": 50.0}
    variants = {cell.variant.name for cell in experiment(name).cells(experiment(name).small)}
    rows = frame(
        *(
            measured(n, key=key, solve_s=float(n), objective=float(n), variant=variant, **overlaps)
            for n, key in ((3, "a300"), (4, "a3040"))
            for variant in variants
        )
    )
    figure = experiment(name).figure(rows)
    assert figure.get_suptitle()
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert all(labels)
    assert any("[" in label for label in labels)
    assert all(axes.get_xlabel() for axes in figure.axes[-1:])
