"""The audit at extremes: other sizes, a turned world, bodies in one place, a flat platform, absurd numbers."""

import json
import math

import numpy as np
import pytest
from suites import few
from verify_cases import FREE_ABOVE, changed, design, fan

from topo_search.model import Status, Topology
from topo_search.model.files import to_json
from verify import audit


def test_turning_the_world_changes_no_clearance():
    psi = 0.8
    c, s = math.cos(psi), math.sin(psi)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])

    def turned(vectors):
        return [(turn @ vector).tolist() for vector in np.array(vectors, dtype=float)]

    segments = [[0.5, 0.2, 1.0], [1.0, 0.0, 0.3]]
    still = audit(fan({"exposure": [{"kind": "directional", "segments": segments}]}, end_effector=(0.1, 0.0, 0.6)))
    moved = audit(
        fan(
            {"exposure": [{"kind": "directional", "segments": turned(segments)}]},
            root=(psi, 0.0, 0.0),
            end_effector=tuple(turn @ (0.1, 0.0, 0.6)),
        )
    )
    assert [p.analytic_m for p in moved.pairs] == pytest.approx([p.analytic_m for p in still.pairs], abs=1e-12)
    assert moved.verdict == still.verdict


@pytest.mark.parametrize("scale", [1e-3, 1e3])
@pytest.mark.parametrize("hinges", [(-0.6, 0.6), (0.3, 0.6)])
def test_a_platform_of_another_size_is_judged_alike(scale, hinges):
    def sized(k):
        module = {
            "arm_length": 0.1 * k,
            "connector_distance": 0.15 * k,
            "torque_coefficient": 1.06e-8 * k,
            "body": {
                "rotor_radius": 0.05 * k,
                "rotor_height": 0.02 * k,
                "arm_width": 0.02 * k,
                "hub": [0.08 * k, 0.08 * k, 0.04 * k],
            },
        }
        exposure = [{"kind": "local", "radius": 0.15 * k}, {"kind": "exterior", "half_angle_deg": 70.0}]
        task = {"module": module, "exposure": exposure, "end_effector": {"rod_radius": 0.005 * k}}
        return fan(task, hinges=hinges, end_effector=(0.0, 0.0, 0.6 * k))

    one, other = audit(sized(1.0)), audit(sized(scale))
    assert other.verdict == one.verdict
    assert [p.status for p in other.pairs] == [p.status for p in one.pairs]
    assert [p.analytic_m / scale for p in other.pairs] == pytest.approx([p.analytic_m for p in one.pairs], rel=1e-9)
    assert [r.status for r in other.residuals] == [r.status for r in one.residuals]


def test_modules_in_one_place_are_judged():
    # Four right angles close a square: the fifth module is where the first is.
    ring = Topology(((-1, -1, -1), (0, 0, 2), (1, 1, 3), (2, 2, 0), (3, 3, 1)))
    result = audit(design(ring, {}, hinges=(0.0, 0.0, 0.0, 0.0)))
    assert result.verdict == Status.VIOLATED
    (same,) = (pair for pair in result.pairs if (pair.kind, pair.a, pair.b) == ("airflow", 0, 4))
    assert same.analytic_m == pytest.approx(-2 * fan().task.module.envelope.end_radius, rel=1e-9)
    assert result.interference.deepest_percent == pytest.approx(100.0, rel=1e-12)


def test_an_end_effector_in_a_module_is_judged():
    result = audit(fan({"exposure": FREE_ABOVE[:1]}, end_effector=(0.0, 0.0, 0.0)))
    assert result.verdict == Status.VIOLATED
    (inside,) = (pair for pair in result.pairs if pair.kind == "exclusion" and pair.a == 0)
    assert inside.analytic_m == pytest.approx(-0.15)


@pytest.mark.parametrize("huge", few([1e7, 1.7e308, 1e100, 1e200], 2))
@pytest.mark.parametrize("field", ["end_effector_m", "rotor_speeds_squared", "hinge_angles_rad", "objective"])
def test_absurd_numbers_are_judged_and_written(field, huge):
    given = fan({"exposure": FREE_ABOVE})
    value = {
        "end_effector_m": [huge, -huge, huge],
        "rotor_speeds_squared": [[huge] * 12],
        "hinge_angles_rad": [huge, -huge],
        "objective": huge,
    }[field]
    result = audit(changed(given, **{field: value}))
    assert result.verdict in {Status.VIOLATED, Status.UNDECIDED}
    assert json.loads(to_json(result))["verdict"] == result.verdict


def test_rows_of_every_kind_count_towards_the_most(monkeypatch):
    given = fan({"exposure": FREE_ABOVE})
    rows = audit(given).pairs
    assert {row.kind for row in rows} >= {"airflow", "separation", "body", "rod", "rotor-airflow", "rod-airflow"}
    monkeypatch.setattr("verify.design_audit.MOST_CLEARANCES", len(rows))
    assert audit(given).pairs == rows
    monkeypatch.setattr("verify.design_audit.MOST_CLEARANCES", len(rows) - 1)
    with pytest.raises(ValueError, match="clearances, but this one has more"):
        audit(given)
