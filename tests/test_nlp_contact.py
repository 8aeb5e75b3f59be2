"""A load case with `contact` is solved and audited as one beside the same wall, written out."""

from typing import Any

import numpy as np
import pytest

from nlp import solve
from topo_search.model import BadInput, Design, Status, Task, Topology
from topo_search.model.files import to_json, validate
from topo_search.topologies import resolve_symmetry
from verify import audit

TREE = Topology.from_key("a300")
HOVER = {"carries_weight": True}


def task(*cases: dict[str, Any], **fields: Any) -> Task:
    flight = {"defaults": False}  # two starts find a design on paper
    return validate(
        Task, {"name": "t", "modules": 3, "load_cases": [*cases, HOVER], "flight": flight, **fields}, "t"
    )


def force(*f: float, **fields: Any) -> dict[str, Any]:
    return {"carries_weight": True, "end_effector": {"force": list(f)}, **fields}


def solved(asked: Task) -> Design:
    design = solve(asked.resolve(3), TREE, starts=range(8), seed=0)
    assert isinstance(design, Design)
    return design


@pytest.mark.parametrize(("contact", "outwards"), [("push", [0.0, -1.0, 1.0]), ("pull", [0.0, 1.0, -1.0])])
def test_contact_is_the_wall_that_one_would_write(contact: str, outwards: list[float]) -> None:
    wall = {"kind": "allowed", "planes": [{"normal": outwards}], "solid": True, "geometry": False}
    design = solved(task(force(0.0, -0.1, 0.1, contact=contact)))
    stated = solved(task(force(0.0, -0.1, 0.1), exposure=[wall]))
    assert design.objective == pytest.approx(stated.objective, rel=1e-9)
    tip, stated_tip = np.abs([design.end_effector_m, stated.end_effector_m])  # up to a mirror image
    np.testing.assert_allclose(tip, stated_tip, atol=1e-9)
    found, same = audit(design), audit(stated)
    assert found.verdict == same.verdict == Status.CLEAR
    assert Design.model_validate_json(to_json(design)) == design
    pairs = [pair for pair in found.pairs if pair.kind in ("part-region", "rod-region")]
    assert {pair.name.split(" and ")[1] for pair in pairs} == {"object of load case 0"}
    stated_pairs = [pair for pair in same.pairs if pair.kind in ("part-region", "rod-region")]
    gaps, stated_gaps = (sorted(pair.analytic_m for pair in each) for each in (pairs, stated_pairs))
    assert gaps == pytest.approx(stated_gaps, abs=1e-9)
    assert not found.placement or not found.placement.pulling


def test_all_objects_hold_equal_ones_once_and_a_design_has_them_written_out() -> None:
    asked = task(
        force(0.2, 0.0, 0.0, contact="push"),
        force(0.0, -0.1, 0.0, contact="pull", units="SI"),
        force(0.1, 0.0, 0.0, contact="push"),
        exposure=[{"kind": "local"}],
    )
    resolved = asked.resolve(3)
    assert [(region.contact, region.kind) for region in resolved.exposure] == [
        (None, "local"), (0, "exterior"), (1, "exterior")
    ]  # fmt: skip
    assert [region.axis for region in resolved.exposure[1:]] == [(-1.0, 0.0, 0.0), (0.0, -1.0, 0.0)]
    assert {case.contact for case in resolved.load_cases} == {None}
    assert resolved.resolve(3) == resolved
    given = resolved.model_dump(mode="json")
    given["load_cases"][1]["contact"] = "push"
    with pytest.raises(BadInput, match=r"load_cases\[1\].contact: must be left out in a design"):
        validate(type(resolved), given, "design")


def test_a_symmetry_of_the_forces_is_one_of_the_task_only_if_it_is_one_of_the_objects() -> None:
    one, other = (force(0.2, y, 0.0) for y in (0.1, -0.1))
    contact = {"contact": "push"}
    assert "reflection" in resolve_symmetry(task(one, other).resolve(3)).reason
    assert "reflection" in resolve_symmetry(task(one | contact, other | contact).resolve(3)).reason
    assert "no mirror" in resolve_symmetry(task(one | contact, other).resolve(3)).reason


@pytest.mark.parametrize(
    ("cases", "fault"),
    [
        (
            [{"carries_weight": True, "contact": "push"}],
            'load_cases[0].contact: must be left out without a force at the end-effector, but got "push"',
        ),
        ([force(1.0, 0.0, 0.0, contact="lean")], 'load_cases[0].contact: must be "push" or "pull", but got "lean"'),
        (
            [force(1.0, float(k), 0.0, contact="push") for k in range(21)],
            "exposure: must have at most 20 entries, objects of `contact` included",
        ),
    ],
)
def test_a_contact_that_cannot_be_is_refused_in_one_line(cases: list[dict[str, Any]], fault: str) -> None:
    with pytest.raises(BadInput) as caught:
        task(*cases)
    assert [str(one)[: len(fault)] for one in caught.value.faults] == [fault]
