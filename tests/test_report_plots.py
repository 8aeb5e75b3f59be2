"""Plots of an answer show what its frames hold."""

import numpy as np
import pytest
from toy_problem import toy_run, toy_task

import topo_search
from topo_search import plot_candidates, plot_front, plot_history, read_answer
from topo_search.model import BadInput


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    path = tmp_path_factory.mktemp("plots") / "run"
    toy_run(path, task=toy_task((3, 4)))
    return path


def points(figure, name):
    return [list(zip(trace.x, trace.y, strict=True)) for trace in figure.data if trace.name == name]


def test_candidates_of_every_size_are_drawn_by_two_columns(path):
    answer = read_answer(path)
    figure = plot_candidates(answer, x="gap", y="objective")
    for n, rows in answer.candidates.dropna(subset=["objective"]).groupby("modules"):
        assert points(figure, f"{n} modules") == [list(zip(rows["gap"], rows["objective"], strict=True))]
    with pytest.raises(BadInput, match=r"y: must be one of modules, .*, but got audit"):
        plot_candidates(answer, x="gap", y="audit")


@pytest.mark.parametrize("n", [3, 4])
def test_the_history_ends_with_the_best_of_its_size(path, n):
    answer = read_answer(path)
    rows = answer.candidates.query("modules == @n")
    ((*_, (solves, last)),) = points(plot_history(answer, n), "incumbent")
    assert solves == answer.solves["key"].isin(rows["key"]).sum()
    assert last == pytest.approx((rows["objective"] / rows["lower_bound"]).min())
    with pytest.raises(BadInput, match="modules: must be one of 3, 4, but got 5"):
        plot_history(answer, 5)


def test_a_run_without_goals_has_no_front_to_draw(path):
    with pytest.raises(BadInput, match="goal: must be one of none, but got None"):
        plot_front(read_answer(path))


def test_a_front_is_drawn_over_each_goal_that_it_has_figures_for(tmp_path):
    answer = toy_run(tmp_path / "run", task=toy_task().replace(goals={"peak_input": [1.0, 0.9]}))
    figure = plot_front(answer, "peak_input")
    least = answer.front["objective"].min()
    front = sorted(zip(answer.front["peak_input"], answer.front["objective"] / least, strict=True))
    assert np.array(sorted(*points(figure, "designs of the front"))) == pytest.approx(np.array(front))
    assert plot_front(answer).layout.xaxis.title.text
    with pytest.raises(BadInput, match=r"goal: must be one of .*, but got gain"):
        plot_front(answer, "gain")
    assert points(plot_history(answer), "incumbent")
    assert len(plot_candidates(answer, x="gap").data) == 1


def test_only_public_names_are_listed():
    assert sorted(topo_search.__all__) == dir(topo_search)
    assert all(getattr(topo_search, name) is not None for name in dir(topo_search))
