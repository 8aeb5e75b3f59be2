import pandas as pd
import pytest
from experiment_rows import frame, measured

from topo_search.cli.experiment import NAMES
from topo_search.experiments import experiment
from topo_search.experiments.comparisons import tree_of
from topo_search.experiments.paper import growth
from topo_search.experiments.study import roots


def push(key, variant, objective=None, gap=None):
    status = "infeasible" if objective is None else "feasible"
    return measured(5, task="push", key=key, variant=variant, status=status, objective=objective, gap=gap)


def test_growth_is_the_exponent_of_the_power_law():
    rows = frame(
        *(measured(n, solve_s=2e-4 * n**2) for n in (10, 20, 40, 100)),
        *(measured(n, solve_s=1e-3 * n, build_s=1e-3 * n, task="ten-wrenches-local") for n in (10, 20, 40)),
        measured(10, solve_s=5.0, task="ten-wrenches-directional"),
        measured(60, status="infeasible", solve_s=500.0),
    )
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
        measured(20, status="infeasible", solve_s=9.0),
    )
    row, larger = experiment("scaling").summary(rows).to_dict(orient="records")
    assert (row["trees"], row["share_solved"], row["share_clear"]) == (4, 0.5, 0.25)
    assert (row["seconds_median"], row["seconds_max"], row["iterations_median"]) == (2.0, 3.0, 20.0)
    assert row["peak_mb"] == 400.0
    assert row["gap_median"] == pytest.approx(0.2)
    assert larger["share_solved"] == 0.0
    assert pd.isna(larger["seconds_median"])


def test_the_ablation_s_metrics():
    def overlap(n, cluster, *depths):
        return measured(
            n,
            variant="separation",
            colliding_pairs=len(depths),
            largest_cluster=cluster,
            deepest_percent=max(depths, default=0.0),
            depths_percent=" ".join(map(str, depths)) or None,
        )

    rows = frame(
        overlap(10, 0),
        overlap(10, 5, 96.0, 95.0, 20.0, 10.0),
        overlap(10, 6, 80.0, 50.0, 40.0, 30.0, 20.0, 10.0),
        overlap(20, 18, 99.95, *[60.5] * 8),
        measured(20, variant="separation", status="infeasible"),
    )
    ten, twenty = experiment("ablation").summary(rows).to_dict(orient="records")
    assert (ten["designs"], ten["pairs_median"], ten["cluster_median"]) == (3, 4, 5)
    assert ten["share_colliding"] == pytest.approx(2 / 3)
    assert ten["share_deepest_reached"] == pytest.approx(1 / 3)
    assert (ten["share_deepest_fully_reached"], twenty["share_deepest_fully_reached"]) == (0.0, 1.0)
    assert ten["deepest_median_percent"] == 80.0
    assert (ten["pair_depth_median_percent"], ten["share_pairs_reached"]) == (35.0, 0.2)
    assert twenty["pair_depth_median_percent"] == 60.5
    assert (twenty["trees"], twenty["designs"], twenty["cluster_share_median"]) == (2, 1, 0.9)


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
    assert (reference["best_gap"], other["best_gap"]) == (0.05, 0.3)


def test_with_the_paper_s_root_a_tree_has_the_effort_of_its_best_root():
    keys = roots("a3010")
    assert {tree_of(key) for key in keys} == {tree_of("a3010")}
    efforts = [20.0, 13.0, *[None] * (len(keys) - 2)]
    rows = frame(
        push("a3010", "free root", 10.0, 0.1),
        push("a300", "free root"),
        *(push(key, "paper root", effort, 0.5) for key, effort in zip(keys, efforts, strict=True)),
    )
    free_root, paper_root = experiment("root").summary(rows).to_dict(orient="records")
    assert (free_root["topologies"], free_root["trees"], free_root["trees_solved"]) == (2, 2, 1)
    assert (paper_root["topologies"], paper_root["trees"], paper_root["trees_solved"]) == (len(keys), 1, 1)
    assert paper_root["share_solved"] == pytest.approx(2 / len(keys))
    assert paper_root["effort_ratio_median"] == pytest.approx(1.3)


def test_trees_with_wrenches_of_their_own_have_no_best():
    rows = frame(
        *(
            measured(10, key=key, variant=variant, objective=effort, gap=gap)
            for key, variant, effort, gap in (("a300", "free", 10.0, 0.1), ("a300", "com", 12.0, 0.2))
        ),
    )
    table = experiment("placement").summary(rows).set_index("variant")
    assert table["best_ratio"].isna().all()
    assert table["best_gap"].isna().all()
    assert table.loc["com", "effort_ratio_median"] == pytest.approx(1.2)


@pytest.mark.parametrize("status", ["feasible", "infeasible"])
@pytest.mark.parametrize("name", NAMES)
def test_figures_have_titles_axes_and_units_even_without_designs(name, status):
    overlaps = {"colliding_pairs": 1, "largest_cluster": 2, "deepest_percent": 50.0, "depths_percent": "50.0"}
    values = {"solve_s": 3.0, "objective": 2.0, **overlaps} if status == "feasible" else {}
    asked = experiment(name)
    rows = frame(
        *(
            measured(n, key=key, variant=variant.name, status=status, **values)
            for n, key in ((3, "a300"), (4, "a3040"))
            for variant in asked.variants
        )
    )
    assert len(asked.summary(rows)) == 2 * len(asked.variants)
    figure = asked.figure(rows)
    figure.canvas.draw()
    assert figure.get_suptitle()
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert all(labels)
    assert any("[" in label for label in labels)
    assert all(axes.get_xlabel() for axes in figure.axes[-1:])
