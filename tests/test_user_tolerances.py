"""Clearances that survive errors of building, from a task to an audited answer."""

from typing import Any

import pytest

from topo_search import Audit, Design, Task, Topology, compose
from topo_search.study import Solved


def solved(**given: Any) -> Solved:
    forces = ([0.5, 0.0, 0.5], [0.0, 0.5, 0.5])
    cases = [*({"end_effector": {"force": force}} for force in forces), {"com": {"force": [0.0, 0.0, 1.0]}}]
    task = {"name": "push", "modules": 5, "load_cases": cases, "tolerances": {"hinge_angle_deg": 0.2}}
    return compose.solve(Task.model_validate({**task, **given}), Topology.from_key("a70010"), starts=8, seed=0)


@pytest.mark.slow
def test_a_design_survives_the_tolerances_where_the_task_asks() -> None:
    drawn, built = solved(flight={"tolerances": False}), solved()
    least = []
    for answer in (drawn, built):
        assert isinstance(answer.outcome, Design)
        assert isinstance(answer.audit, Audit)
        assert answer.audit.verdict == "clear"
        assert answer.audit.sensitivity.tolerances is not None
        least.append(answer.audit.sensitivity.tolerances)
    assert least[0].status == "violated"
    assert least[1].status == "clear"
    assert least[0].lower_m < 0 < least[1].lower_m
    assert drawn.notes == ()
    assert built.notes == ("the audit of the design with margin 0.0001 m is violated",)
    assert drawn.design.objective < built.design.objective < 1.03 * drawn.design.objective
