"""Cones that come last: where the end-effector is moved to, and what the second try brings."""

from dataclasses import replace

import numpy as np
import pytest

from nlp.evaluate import exposure_gaps, violations, worst
from nlp.finish import finish
from nlp.one_stage import one_stage
from nlp.program import TWO_STAGES_FROM, program
from nlp.starts import draw, generator
from nlp.two_stages import DIRECTIONS, DISTANCES, TwoStages, directions, moved_out
from topo_search.model.files import read_task
from topo_search.topologies import sample

CONE = "push-exterior-60"


def a_start(example, n, *settings, tree=0):
    task = read_task(example, (f"modules={n}", *settings)).resolve(n)
    topology = sample(n, 1, tree)[0]
    return draw(task, topology, generator(task, topology, 0, 0))


def least_gap(point):
    return min(float(gaps.min()) for *_, gaps in exposure_gaps(point))


@pytest.mark.parametrize("axis", ["com", [0.0, 0.0, -1.0]])
@pytest.mark.parametrize("n", [3, 9])
def test_the_end_effector_moves_to_the_nearest_place_at_which_the_cone_holds_all_airflow(axis, n):
    start = a_start(
        CONE, n, f'exposure=[{{kind="exterior", half_angle_deg=60.0, axis={axis!r}}}]'.replace("'", '"')
    )
    moved = moved_out(start)
    assert least_gap(moved) >= 0
    assert np.array_equal(moved.alpha, start.alpha)
    assert np.array_equal(moved.root, start.root)
    centroid = start.poses[1].mean(axis=0)
    distances = DISTANCES * start.task.module.arm_length
    nearer = distances[np.argmin(np.abs(distances - np.linalg.norm(moved.p_E - centroid))) - 1]
    for direction in directions(DIRECTIONS):
        assert least_gap(replace(start, p_E=centroid + nearer * direction)) < 0


def test_there_may_be_no_such_place():
    start = a_start(CONE, 9, 'exposure=[{kind="exterior", half_angle_deg=0.1, axis="com"}]')
    assert moved_out(start) is None


def test_directions_are_spread_evenly():
    d = directions(DIRECTIONS)
    assert np.allclose(np.linalg.norm(d, axis=1), 1.0)
    assert np.allclose(d.T @ d / len(d), np.eye(3) / 3, atol=0.01)
    apart = d @ d.T - 2 * np.eye(len(d))
    assert np.arccos(apart.max(axis=1)).min() > 0.6 * np.arccos(apart.max(axis=1)).max()


def test_two_stages_are_for_many_modules_with_a_cone_and_a_free_end_effector():
    def stages(example, n, *settings):
        start = a_start(example, n, *settings)
        return isinstance(program(start.task, start.topology), TwoStages)

    assert stages(CONE, TWO_STAGES_FROM)
    assert not stages(CONE, TWO_STAGES_FROM - 1)
    assert not stages("push-directional", TWO_STAGES_FROM)
    assert not stages(CONE, TWO_STAGES_FROM, "end_effector.position=[0.0, 0.0, 0.5]")


@pytest.mark.parametrize(("tree", "stages"), [(0, 1), (14, 2), (35, None)])
def test_a_start_is_tried_again_only_where_one_stage_does_not_do(tree, stages):
    """The trees are those of 40 whose first starts end so."""
    start = a_start("ten-wrenches-exterior-60", 8, "search.body_clearance=false", tree=tree)
    once = one_stage(start.task, start.topology).solve(start)
    answer = TwoStages(start.task, start.topology).solve(start)
    assert is_design(once.point) == (stages == 1)
    assert is_design(answer.point) == (stages is not None)
    assert answer.point.task == start.task
    assert np.array_equal(answer.point.pack(), once.point.pack()) == (stages != 2)
    assert (answer.iterations > once.iterations) == (stages != 1)


def is_design(point):
    return worst(violations(finish(point))).met
