"""The shortest rod at a design's effort, and what a shorter one costs."""

import pytest
from older import older_task

from nlp import solve
from topo_search.model import Design, Task, Topology
from topo_search.model.proven import upper_text
from verify import audit

TREE = Topology.from_key("a300")


def rod_of(design: Design) -> float:
    """The rod of the best design from the audit's own sheet [m]."""
    return audit(design).assembly.end_effector.connectors[0].length_m


def solved(task: Task, *, near: tuple[Design, ...] = ()) -> Design:
    design = solve(task.resolve(3), TREE, starts=range(0 if near else 2), seed=0, near=near)
    assert isinstance(design, Design)
    return design


def with_reach(task: Task, metres: float) -> Task:
    return task.model_copy(update={"end_effector": task.end_effector.model_copy(update={"largest_reach": metres})})


def test_where_the_effort_does_not_depend_on_it_the_rod_is_short() -> None:
    """A platform that only hovers, above a ball that must stay out of its airflow: any longer rod does as well."""
    fields = {"mass": 0.0, "stand_off": 0.3, "largest_reach": 2.5}
    module, case = {"torque_coefficient": 1.06e-8}, {"carries_weight": True}
    task = {"name": "hover", "modules": 3, "module": module, "end_effector": fields, "load_cases": [case]}
    design = solved(older_task(task))
    record = (design.solver or {})["shorter_rod"]
    assert rod_of(design) < 0.4
    assert record is None or record["length_m"] < rod_of(design)
    assert audit(design).verdict == "clear"


def test_what_a_shorter_rod_costs_is_what_a_shorter_reach_costs() -> None:
    push = {"units": "SI", "carries_weight": True, "end_effector": {"force": [2.0, 0.0, 0.0]}}
    ball = {"kind": "local", "radius": 0.2}
    task = older_task(name="push", modules=3, load_cases=[push], exposure=[ball])
    design = solved(task)
    shorter = (design.solver or {})["shorter_rod"]
    assert shorter["length_m"] == pytest.approx(0.9 * rod_of(design), rel=1e-6)
    narrow = solved(with_reach(task, shorter["length_m"]), near=(design,))
    assert narrow.objective / design.objective - 1 == pytest.approx(shorter["cost"], rel=1e-2)
    assert shorter["cost"] > 0
    assert design.shorter_rod == (
        f"a rod of at most {upper_text(shorter['length_m'], 3)} m adds {100 * shorter['cost']:.2g} % "
        "control effort, solved from this design"
    )


@pytest.mark.parametrize("fields", [{"rod": "none"}, {"position": [0.35, 0.0, 0.0]}])
def test_without_a_rod_of_free_length_nothing_is_said(fields: dict[str, object]) -> None:
    case = {"carries_weight": True, "end_effector": {"force": [0.1, 0.0, 0.0]}}
    design = solved(older_task(name="t", modules=3, end_effector=fields, load_cases=[case]))
    assert design.shorter_rod is None
