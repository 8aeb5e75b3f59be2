import csv
import tempfile
from dataclasses import astuple
from pathlib import Path

import pandas as pd
import pytest

from topo_search.experiments import experiment, results
from topo_search.experiments.measured import COLUMNS, Measured
from topo_search.experiments.scaling import growth


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
    assert "n^1.0 to n^2.0 over the 2 exposure settings" in fits[1]
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
        "least 0 %.",
        "The largest cluster holds 55% of the modules in the median; it is about half (40% to 60%) of them in 50% "
        "of the designs, more in 25%.",
        "The median number of colliding pairs goes from 4 with 10 modules to 9 with 20, growing with every step in "
        "size.",
    ]


@pytest.mark.parametrize("name", ["scaling", "ablation"])
def test_an_experiment_without_any_design_says_so_and_can_be_drawn(name):
    rows = frame(measured(10, status="infeasible"), measured(20, status="failed"))
    asked = experiment(name)
    assert asked.findings(rows)
    assert len(asked.summary(rows)) == 2
    asked.figure(rows)


@pytest.mark.parametrize("name", ["scaling", "ablation"])
def test_figures_have_titles_axes_and_units(name):
    overlaps = {"colliding_pairs": 1, "largest_cluster": 2, "deepest_percent": 50.0, "median_percent": 50.0}
    rows = frame(*(measured(n, solve_s=float(n), **overlaps) for n in (10, 20)))
    figure = experiment(name).figure(rows)
    assert figure.get_suptitle()
    labels = [axes.get_ylabel() for axes in figure.axes]
    assert all(labels)
    assert any("[" in label for label in labels)
    assert all(axes.get_xlabel() for axes in figure.axes[-1:])
