import numpy as np
import pytest

from topo_search.model import Topology

ROW = Topology.from_key("a2444440")
"""Seven modules in a row that turn to the same side at every one."""


pytestmark = pytest.mark.usefixtures("benchmarks")


@pytest.mark.slow
def test_a_row_that_turns_one_way_is_proven_crowded_at_a_short_distance_and_placed_at_a_long_one() -> None:
    from crowded_parts import OPEN, PROVEN, can_be_placed, prove_crowded, task_of

    assert prove_crowded(task_of(7, 0.22), ROW, 100_000)[1] == PROVEN
    assert not can_be_placed(ROW, 0.22, 20)
    assert prove_crowded(task_of(7, 0.26), ROW, 10_000)[1] == OPEN
    assert can_be_placed(ROW, 0.26, 20)


def test_no_random_angles_place_what_is_proven_crowded() -> None:
    from crowded_parts import task_of
    from untangling import overlaps

    task, rng = task_of(7, 0.22), np.random.default_rng(1)
    assert all(overlaps(task, ROW, alpha) for alpha in rng.uniform(-np.pi / 2, np.pi / 2, (400, 6)))


def test_the_least_part_is_found_in_a_tree_that_holds_it() -> None:
    from crowded_parts import crowded_part, task_of

    graph = ROW.graph()
    graph.add_edge(6, 7, ports={6: 2, 7: 0})
    graph.add_edge(0, 8, ports={0: 0, 8: 2})
    whole = Topology.from_graph(graph)
    assert crowded_part(task_of(9, 0.22), whole, 3).n == 7
