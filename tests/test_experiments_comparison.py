import pytest
from experiment_rows import frame, measured
from wording import says

from topo_search.experiments import Settings, experiment
from topo_search.experiments.comparisons import tree_of
from topo_search.experiments.plan import Variant, plan, roots
from topo_search.topologies import candidates, count


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
    assert (reference["best_gap"], other["best_gap"]) == (0.05, 0.3)
    (found,) = experiment("body").findings(rows)
    assert says(found, "push", "5 modules", "0.30 m", "body clearance: 2 of 4", "airflow only: 3")
    assert says(found, "+5.0%", "median", "+10.0%", "best", "+12.5%", "30.0 %", "5.0 %")


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

    keys = [key for key in rooted if tree_of(key) == free[3]]
    efforts = [20.0, 13.0, *[None] * (len(keys) - 2)]
    rows = frame(
        push(free[3], "free root", 10.0, 0.1),
        push(free[4], "free root"),
        *(push(key, "paper root", effort, 0.5) for key, effort in zip(keys, efforts, strict=True)),
    )
    free_root, paper_root = experiment("root").summary(rows).to_dict(orient="records")
    assert (free_root["topologies"], free_root["trees"], free_root["trees_solved"]) == (2, 2, 1)
    assert (paper_root["topologies"], paper_root["trees"], paper_root["trees_solved"]) == (len(keys), 1, 1)
    assert paper_root["share_solved"] == pytest.approx(2 / len(keys))
    assert paper_root["effort_ratio_median"] == pytest.approx(1.3)


@pytest.mark.parametrize("n", [1, 2, 5])
def test_the_roots_of_all_trees_are_all_rooted_trees(n):
    found = [key for tree in candidates(n) for key in roots(tree.key)]
    assert sorted(found) == [rooted.key for rooted in candidates(n, symmetry="none", root="paper")]


def test_a_large_tree_has_its_roots_without_all_others_of_its_size():
    (cell,) = {
        cell.key: cell for cell in plan(Settings((("push", (40,)),), (1, 1), 1), (Variant("one"),), first=False)
    }.values()
    keys = roots(cell.key)
    assert len(keys) in (40, 80)  # the fewer where a half turn leaves the tree as it is
    assert {tree_of(key) for key in keys} == {cell.key}


def test_roots_are_those_of_the_sampled_trees_alone():
    cells = experiment("root").cells(Settings((("push", (5,)),), (3, 3), 1))
    free = {cell.key for cell in cells if cell.variant.name == "free root"}
    assert len(free) == 3
    assert {tree_of(cell.key) for cell in cells if cell.variant.name == "paper root"} == free


def test_at_the_centre_of_mass_the_task_says_so():
    cells = experiment("placement").cells(Settings((("push", (3,)),), (1, 1), 1))
    asked = [cell.resolve().end_effector for cell in cells]
    assert [(one.position, one.exclusion) for one in asked] == [("free", True), ("com", True), ("com", False)]


def test_trees_with_wrenches_of_their_own_have_no_best():
    rows = frame(
        *(
            measured(10, key=key, variant=variant, objective=effort, gap=gap)
            for key, variant, effort, gap in (
                ("a300", "free", 10.0, 0.1),
                ("a300", "com", 12.0, 0.2),
                ("a500", "free", 4.0, 0.3),
                ("a600", "com", 1.0, 0.4),
            )
        ),
        *(measured(10, key=key, variant="com, inside allowed", status="infeasible") for key in ("a300", "a500")),
    )
    table = experiment("placement").summary(rows).set_index("variant")
    assert table["best_ratio"].isna().all()
    assert table["best_gap"].isna().all()
    com, inside = experiment("placement").findings(rows)
    assert says(
        com, "ten-wrenches", "10 modules", "com: 2 of 2", "free: 2", "+20.0%", "median gap 30.0 %", "20.0 %"
    )
    assert says(inside, "com, inside allowed: 0 of 2", "free: 2")
    assert "%" not in inside


def test_a_study_under_way_says_what_its_rows_say():
    rows = frame(
        push("a300", "free", 10.0, 0.1),
        push("a300", "com", 11.0, 0.2),
        measured(6, task="push", variant="com", objective=3.0, gap=0.1),
        measured(7, task="push", variant="free", objective=3.0, gap=0.1),
    )
    (told,) = experiment("placement").findings(rows)
    assert says(told, "push", "5 modules", "com: 1 of 1", "free: 1")
    _, shares = experiment("placement").figure(rows).axes
    bars = {round(bar.get_x() + bar.get_width() / 2, 2): bar.get_height() for bar in shares.patches}
    width = 0.8 / 3
    places = [0.5 * width - 0.4, 2 + 0.5 * width - 0.4, 1.5 * width - 0.4, 1 + 1.5 * width - 0.4]
    assert bars == {round(place, 2): 100.0 for place in places}
