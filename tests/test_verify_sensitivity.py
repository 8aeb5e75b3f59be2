"""How much error a design tolerates: proven bounds, never optimistic, held against thousands of built platforms."""

import math
from itertools import product
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from nlp_cases import BELOW, CONE, OUTWARDS, PANE, PILLAR, as_design, push, random_point, random_tree, with_rod
from suites import few
from verify_cases import changed, design, failing, fan

from topo_search.model import Assembly, Design, Geometry, Mount, Status, Topology
from topo_search.model.files import to_json
from topo_search.model.sensitivity import WITHIN_TOLERANCES
from verify.bare import complete
from verify.certificate import Certificate
from verify.contacts import AnyCheck, certify
from verify.design_audit import audit
from verify.features import CLEARANCES
from verify.flight.residuals import tolerance_residuals
from verify.kinematics import platform
from verify.requirements import Scene
from verify.sections import Findings
from verify.sensitivity import clearance_of, deviate, sensitivity
from verify.tolerance import Errors, Tolerance

CHAIN = Topology(((-1, -1, -1), (0, 0, 2), (1, 1, 3), (2, 0, 2), (3, 1, 3)))
EVERYTHING: list[dict[str, Any]] = [
    {"kind": "local", "radius": 0.15},
    {"kind": "local", "box": [0.2, 0.3, 0.1]},
    {"kind": "directional", "radius": 0.1, "segments": [[0.0, 0.0, 1.0], [1.0, 0.0, 0.2]]},
    {"kind": "directional", "radius": 0.1, "along": "end_effector", "length": 1.0},
    {"kind": "exterior", "half_angle_deg": 75.0},
    {"kind": "exterior", "half_angle_deg": 50.0, "axis": [0.0, 0.1, -1.0]},
    {"kind": "exterior", "half_angle_deg": 90.0, "axis": [0.0, 0.1, -1.0]},
]
SMALL_AIR = {"airflow": {"start_radius": 0.03, "spread_angle_deg": 4.0, "reach": 0.4}}


def at(of: Design, holder: int | None) -> Mount | None:
    """A free connector of a module, or of any if the module has none."""
    free = of.topology.free_connectors
    return None if holder is None else Mount(module=holder, port=next((p for i, p in free if i == holder), 0))


def checks(scene: Scene, mount: Mount | None) -> list[AnyCheck]:
    return [check for group in CLEARANCES for check in group.checks(scene, mount)]


def certified(some: list[AnyCheck]) -> list[tuple[AnyCheck, Certificate]]:
    return list(zip(some, certify(some), strict=True))


def tolerance(of: Design, holder: int | None = None) -> Tolerance:
    scene = Scene(of)
    return Tolerance(scene, certified(list(scene.requirements())), at(of, holder))


def built_scene(of: Design, errors: Errors, rng: np.random.Generator, mount: Mount | None, *, worst: bool) -> Scene:
    """A platform that is built with random errors, or with errors at their largest."""
    n, l_arm = of.topology.n, of.task.module.arm_length
    directions = rng.normal(size=(n + 1, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    turns = rng.uniform(-1, 1, n - 1)
    return deviate(
        Scene(of),
        turns=errors.delta * (np.sign(turns) if worst else turns),
        shifts=errors.delta_p * l_arm * (directions if worst else directions * rng.random((n + 1, 1)) ** (1 / 3)),
        envelope=errors.delta_e * l_arm * (1.0 if worst else rng.random()),
        mount=mount,
    )


def built(
    of: Design, errors: Errors, rng: np.random.Generator, *, worst: bool, holder: int | None = None
) -> list[AnyCheck]:
    """The requirements of a platform that is built with errors."""
    return list(built_scene(of, errors, rng, at(of, holder), worst=worst).requirements())


def random_platform(seed: int) -> Design:
    rng = np.random.default_rng(seed)
    n = int(rng.integers(2, 8))
    task = push(n, exposure=EVERYTHING, module=SMALL_AIR)
    return as_design(random_point(task, random_tree(n, rng), rng))


@pytest.mark.parametrize("seed", few(range(6), 2))
def test_no_platform_built_within_the_errors_is_below_the_bound(seed: int) -> None:
    of = random_platform(seed)
    rng = np.random.default_rng(1000 + seed)
    holder = int(rng.integers(of.topology.n))
    bounds = tolerance(of, holder)
    for errors in (Errors(delta=0.02), Errors(delta=0.3), Errors(delta_p=0.1), Errors(0.02, 0.05, 0.03)):
        bound = bounds.weakest(errors).bound
        for trial in range(16):
            least = min(map(clearance_of, built(of, errors, rng, worst=trial % 2 == 0, holder=holder)))
            assert least >= bound - 1e-9


@pytest.mark.parametrize("seed", few(range(4), 1))
@pytest.mark.parametrize("kind", ["airflow", "local", "directional", "exterior", "exclusion", "separation"])
def test_every_kind_of_requirement_has_a_bound_of_its_own(seed: int, kind: str) -> None:
    of = random_platform(100 + seed)
    rng = np.random.default_rng(seed)
    found = platform(of)
    scene = Scene(of, found)
    some = [r for r in scene.requirements() if r.kind == kind]
    if not some:  # two modules that are bolted together need no distance
        assert kind == "separation"
        assert of.topology.n == 2
        return
    errors = Errors(0.03, 0.02, 0.01)
    holder = int(rng.integers(of.topology.n))
    for asked in some[:4]:
        bound = Tolerance(scene, certified([asked]), at(of, holder)).weakest(errors).bound
        assert bound <= clearance_of(asked)
        for _ in range(12):
            same = [r for r in built(of, errors, rng, worst=True, holder=holder) if r.key == asked.key]
            assert clearance_of(same[0]) >= bound - 1e-9


def test_adversarial_errors_come_near_the_bound_but_never_below() -> None:
    """Coordinate by coordinate the worst of all hinge errors, from several starts: what the bound must survive."""
    shares = []
    for seed in range(6):
        of = random_platform(200 + seed)
        rng = np.random.default_rng(seed)
        delta = 0.01
        holder = int(rng.integers(of.topology.n))
        weakest = tolerance(of, holder).weakest(Errors(delta=delta))
        name = weakest.check.key

        def left(turns: np.ndarray, of: Design = of, name: Any = name, holder: int = holder) -> float:
            still = np.zeros((of.topology.n + 1, 3))
            scene = deviate(Scene(of), turns=turns, shifts=still, envelope=0.0, mount=at(of, holder))
            return clearance_of(next(r for r in scene.requirements() if r.key == name))

        least = math.inf
        for _ in range(3):
            turns = delta * rng.choice([-1.0, 1.0], of.topology.n - 1)
            for _ in range(2):
                for hinge in range(len(turns)):
                    tried = np.repeat(turns[None], 3, axis=0)
                    tried[:, hinge] = (-delta, 0.0, delta)
                    turns = min(tried, key=left)
            least = min(least, left(turns))
        assert least >= weakest.bound - 1e-9
        nominal = clearance_of(weakest.check)
        if weakest.bound < nominal:  # not the holder's own envelope, which no hinge moves
            shares.append((nominal - least) / (nominal - weakest.bound))
    assert len(shares) >= 4
    assert np.median(shares) > 0.8  # the bound gives away little of what hinges can really take


def test_a_pair_beyond_one_hinge_by_hand() -> None:
    """Two modules in a line: the far end of the second envelope is the arm, and nothing else moves."""
    two = Topology(((-1, -1, -1), (0, 0, 2)))
    of = design(two, {"search": {"body_clearance": False}}, hinges=(-0.5,), end_effector=(0.0, 0.0, 0.8))
    result = audit(of).sensitivity
    gap = min(pair.analytic_m for pair in audit(of).pairs if pair.kind == "airflow")
    # Both sides may be off, and both envelopes may reach farther: half the gap each.
    assert result.position_m.tolerated == pytest.approx(gap / 2, rel=1e-5)
    assert result.envelope_m.tolerated == pytest.approx(gap / 2, rel=1e-5)
    assert result.envelope_m.violated_at == pytest.approx(gap / 2, rel=1e-3)
    assert (result.position_m.kind, result.position_m.a, result.position_m.b) == ("airflow", 0, 1)


def test_errors_that_two_modules_share_cancel() -> None:
    """A long chain before a pair changes nothing for it: its path is all that counts."""
    short = Topology(((-1, -1, -1), (0, 1, 3)))
    # The same two modules with the same hinge between them, at the end of a chain.
    long = Topology(((-1, -1, -1), (0, 0, 2), (1, 0, 2), (2, 1, 3)))
    near = design(short, {}, hinges=(0.5,), end_effector=(0.0, 0.0, 0.8))
    far = design(long, {}, hinges=(-0.2, -0.3, 0.5), end_effector=(0.0, 0.0, 0.8))

    def bound(of: Design, a: int, b: int) -> float:
        found = platform(of)
        scene = Scene(of, found)
        pair = next(r for r in scene.requirements() if (r.kind, r.a, r.b) == ("airflow", a, b))
        return Tolerance(scene, certified([pair]), None).weakest(Errors(delta=0.01)).bound

    assert bound(near, 0, 1) == pytest.approx(bound(far, 2, 3), abs=1e-12)


def test_the_module_that_the_rod_is_bolted_to_holds_the_end_effector() -> None:
    """A ball at the tip keeps its place at the module that carries the rod, and hinges move the others."""
    chain = Topology(((-1, -1, -1), (0, 0, 2), (1, 0, 2)))
    of = design(chain, {"exposure": [{"kind": "local", "radius": 0.15}]}, hinges=(-0.3, -0.3))
    errors = Errors(delta=0.01)
    found = platform(of)
    scene = Scene(of, found)
    local = {r.a: r for r in scene.requirements() if r.kind == "local"}

    def lost(module: int, holder: int) -> float:
        bound = Tolerance(scene, certified([local[module]]), at(of, holder)).weakest(errors).bound
        return clearance_of(local[module]) - bound

    assert lost(2, holder=2) == pytest.approx(0.0, abs=1e-12)
    assert lost(0, holder=0) == pytest.approx(0.0, abs=1e-12)
    assert lost(2, holder=1) > 1e-3
    assert lost(0, holder=2) > lost(0, holder=1) > 1e-3
    for module, port in ((0, 2), (1, 1), (2, 0)):
        result = audit(changed(of, mount={"module": module, "port": port})).sensitivity
        bounds = tolerance(of, holder=module)
        tolerated = math.radians(result.hinge_angle_deg.tolerated)
        assert bounds.weakest(Errors(delta=tolerated)).bound > 0
        assert bounds.weakest(Errors(delta=1.001 * tolerated)).bound < 1e-9


RIGID: dict[str, tuple[int, dict[str, Any]]] = {
    "bolted parts, brackets and a rod": (3, {"module": {**SMALL_AIR, "bracket": {}}}),
    "a solid cone that follows the COM": (2, {"module": SMALL_AIR, **with_rod({**CONE, "half_angle_deg": 85.0})}),
    "solid paths, hull and planes": (
        2,
        {
            "module": SMALL_AIR,
            "end_effector": {"rod": "straight"},
            "exposure": [{**region, "solid": True} for region in (OUTWARDS, PANE, BELOW)],
        },
    ),
    "one module": (1, {"module": SMALL_AIR, **with_rod(PILLAR)}),
}


@pytest.mark.parametrize("name", RIGID)
@pytest.mark.parametrize("seed", few(range(4), 1))
def test_every_check_of_a_rigid_body_has_a_bound(name: str, seed: int) -> None:
    """Random errors, the largest of any size, and the bound's own example."""
    n, fields = RIGID[name]
    rng = np.random.default_rng(seed)
    of = as_design(random_point(push(n, **fields), random_tree(n, rng), rng))
    scene, mount = Scene(of), at(of, n - 1)
    pairs = certified(checks(scene, mount))
    nominal = {check.key: certificate.analytic for check, certificate in pairs}
    bounds = Tolerance(scene, pairs, mount)
    for check, certificate in pairs:
        assert clearance_of(check) == pytest.approx(certificate.analytic, abs=1e-9)
    for errors in (Errors(delta=0.02), Errors(delta_p=0.05), Errors(0.3, 0.02, 0.01), Errors(1e-7, 1e-7, 1e-7)):
        least = {weakest.check.key: weakest for weakest in bounds.checks_up_to(errors, np.inf)}
        assert least.keys() == nominal.keys()
        (example, *_) = bounds.weakest(errors).examples
        shifts = errors.delta_p * scene.l_arm * example.shifts
        other = {"envelope": errors.delta_e * scene.l_arm, "mount": mount}
        for moved in (
            deviate(scene, errors.delta * example.turns, shifts, **other),
            *(built_scene(of, errors, rng, mount, worst=worst) for worst in (True, False)),
        ):
            for check, certificate in certified(checks(moved, mount)):
                if nominal[check.key] > 0:
                    assert certificate.analytic >= least[check.key].bound - 1e-9


def test_the_far_end_of_airflow_has_its_own_lever() -> None:
    """A ball beside the far end of the second module's airflow, which its hinge swings towards the ball."""
    two = Topology(((-1, -1, -1), (0, 0, 2)))
    task = {"exposure": [{"kind": "local", "radius": 0.1}], "module": SMALL_AIR}
    of = design(two, task, hinges=(0.0,), end_effector=(0.55, 0.0, -0.4))
    scene = Scene(of)
    ball = next(r for r in scene.requirements() if (r.kind, r.a) == ("local", 1))
    delta, still = 1e-3, np.zeros((3, 3))
    bound = Tolerance(scene, certified([ball]), None).weakest(Errors(delta=delta)).bound
    swung = [deviate(scene, np.array([s * delta]), still, envelope=0.0, mount=None) for s in (-1.0, 1.0)]
    attained = min(clearance_of(r) for s in swung for r in s.requirements() if r.key == ball.key)
    lost = clearance_of(ball) - attained
    assert lost > 3 * delta  # in arm lengths: the lever is that of the far end
    assert 0 <= attained - bound < 0.02 * lost


def test_parts_that_nearly_touch_are_what_errors_break_first() -> None:
    two, module = Topology(((-1, -1, -1), (0, 0, 2))), {"body": {"rotor_radius": 0.076}}
    of = design(two, {"module": module, "tolerances": {"position": 1e-3}}, hinges=(-0.5,))
    found = audit(of)
    body = next(pair for pair in found.pairs if pair.kind == "body")
    assert 0 < body.lower_m < 2e-3
    assert found.verdict == Status.VIOLATED
    assert WITHIN_TOLERANCES in failing(found)
    assert all(pair.status == Status.CLEAR for pair in found.pairs)
    worst, limit = found.sensitivity.tolerances, found.sensitivity.position_m
    assert (worst.kind, limit.kind) == ("body", "body")
    assert worst.lower_m == pytest.approx(worst.attained_m, rel=1e-9)
    assert worst.lower_m < 0
    assert limit.tolerated == pytest.approx(body.analytic_m / 2, rel=1e-3)
    assert limit.violated_at == pytest.approx(limit.tolerated, rel=2e-3)
    assert found.sensitivity.hinge_angle_deg.kind == "body"


@pytest.mark.parametrize("density", [0.3, 4.0])
def test_the_mass_of_a_rod_turns_a_region_that_follows_the_com(density: float) -> None:
    rod = {"rod": "straight", "largest_reach": 2.0, "rod_mass": "included", "rod_linear_density": density}
    cone = {"kind": "exterior", "half_angle_deg": 46.0, "axis": "com"}
    module = {"mass": 0.24, "airflow": {"start_radius": 0.03, "spread_angle_deg": 20.0}}
    task = {"exposure": [cone], "module": module, "end_effector": {"mass": 0.01, **rod}}
    drawn = design(Topology(((-1, -1, -1),)), task, hinges=(), end_effector=(0.0, 0.0, 0.4))
    fields = {name: getattr(drawn, name) for name in Geometry.model_fields}
    of = complete(Geometry(**{**fields, "mount": Mount(module=0, port=0)}))
    limit = audit(of).sensitivity.position_m
    assert limit.kind == "exterior"
    assert 0 < limit.tolerated < limit.violated_at
    scene = Scene(of)
    longer = deviate(scene, np.zeros(0), np.array([[0.0] * 3, [0.0, 0.0, 0.05]]), envelope=0.0, mount=of.mount)
    lengths = [2 * float(np.linalg.norm(placed.platform.rod[0, 1])) for placed in (scene, longer)]
    masses = [placed.design.task.end_effector.counted_rod.mass for placed in (scene, longer)]
    assert masses == pytest.approx([density * length for length in lengths])


def test_a_rod_that_grows_heavier_with_its_length_is_within_the_bound() -> None:
    """All modules move away from p_E along the rod: the COM follows them, and the mass that the rod gains."""
    line = Topology(((-1, -1, -1), *((i, 0, 2) for i in range(4))))
    rod = {"rod": "straight", "largest_reach": 2.0, "rod_mass": "included", "rod_linear_density": 1.5}
    task = {
        "exposure": [{"kind": "exterior", "half_angle_deg": 80.0}],
        "module": {"mass": 0.15, **SMALL_AIR},
        "end_effector": {"mass": 0.01, **rod},
    }
    drawn = design(line, task, hinges=(0.0,) * 4, end_effector=(0.4, 0.0, 0.05))
    fields = {name: getattr(drawn, name) for name in Geometry.model_fields}
    of = complete(Geometry(**{**fields, "mount": Mount(module=0, port=1)}))
    scene = Scene(of)
    cone = next(r for r in scene.requirements() if (r.kind, r.a) == ("exterior", 4))
    v, along_rod = scene.offset / np.linalg.norm(scene.offset), scene.platform.rod[0, 1]
    across = along_rod - (along_rod @ v) * v
    delta_p = 1e-3
    shift = delta_p * scene.l_arm * across / np.linalg.norm(across)
    moved = deviate(scene, np.zeros(4), np.array([*[-shift] * 5, shift]), envelope=0.0, mount=of.mount)
    attained = next(clearance_of(r) for r in moved.requirements() if r.key == cone.key)
    bound = Tolerance(scene, certified([cone]), of.mount).weakest(Errors(delta_p=delta_p)).bound
    lost = clearance_of(cone) - attained
    assert lost > 20 * delta_p  # the module is far from p_E, and the COM near
    assert 0 <= attained - bound < 0.15 * lost


def test_the_failure_names_the_tolerance_that_a_design_does_not_hold() -> None:
    errors = {"hinge_angle_deg": 1e-3, "position": 0.2}
    of = fan({"tolerances": errors})
    found = audit(of)
    failure = found.failure(of.task)
    assert "tolerances.position = 0.2" in failure
    assert "hinge_angle_deg" not in failure
    alone = found.sensitivity
    both = {"hinge_angle_deg": 0.9 * alone.hinge_angle_deg.tolerated, "position": 0.9 * alone.position_m.tolerated}
    of = fan({"tolerances": both})
    assert "at once" in audit(of).failure(of.task)


def test_an_example_within_what_is_proven_is_inconsistent() -> None:
    of = fan({"tolerances": {"position": 1e-4}, "flight": {"tolerances": False}})
    found = audit(of).sensitivity
    assert list(tolerance_residuals(of, found)) == []
    for name in ("hinge_angle_deg", "position_m", "envelope_m"):
        limit = getattr(found, name)
        wrong = limit.model_copy(update={"violated_at": 0.9 * limit.tolerated})
        (row,) = tolerance_residuals(of, found.model_copy(update={name: wrong}))
        assert row.status == Status.INCONSISTENT
        assert row.derived < row.stated


@settings(max_examples=25)
@given(st.floats(1e-4, 0.2), st.floats(1.0, 3.0))
def test_larger_errors_never_leave_more(delta: float, factor: float) -> None:
    bounds = tolerance(fan({"exposure": EVERYTHING[:4]}))
    errors = Errors(delta, delta, delta)
    assert bounds.weakest(errors.times(factor)).bound <= bounds.weakest(errors).bound + 1e-12


@pytest.mark.parametrize("scale", few([1e3, 1e-2], 1))
def test_angles_do_not_depend_on_the_unit_of_length_and_lengths_scale_with_it(scale: float) -> None:
    def scaled(by: float) -> Design:
        sizes = {"rotor_radius": 0.05, "rotor_height": 0.02, "arm_width": 0.01}
        body = {"hub": [0.06 * by, 0.06 * by, 0.03 * by], **{name: size * by for name, size in sizes.items()}}
        module = {"arm_length": 0.1 * by, "connector_distance": 0.15 * by, "body": body}
        rod = {"rod_radius": 0.004 * by}
        return fan({"module": module, "end_effector": rod}, end_effector=(0.0, 0.0, 0.6 * by))

    one, other = audit(scaled(1.0)).sensitivity, audit(scaled(scale)).sensitivity
    assert other.hinge_angle_deg.tolerated == pytest.approx(one.hinge_angle_deg.tolerated, rel=1e-4)
    assert other.position_m.tolerated == pytest.approx(scale * one.position_m.tolerated, rel=1e-4)


def test_what_is_tolerated_is_clear_and_what_violates_is_violated() -> None:
    of = fan({"exposure": EVERYTHING[:4]}, end_effector=(0.0, 0.0, 0.8))
    result = audit(of).sensitivity
    within, beyond = result.hinge_angle_deg.tolerated, result.hinge_angle_deg.violated_at
    assert 0 < within < beyond
    for signs in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        hinges = [a + math.radians(within) * s for a, s in zip(of.hinge_angles_rad, signs, strict=True)]
        turned = changed(of, hinge_angles_rad=hinges)
        assert all(pair.status == Status.CLEAR for pair in audit(turned).pairs)


@pytest.mark.parametrize("seed", few([28, 39, 83], 1))
def test_the_pair_that_is_named_breaks_first_of_all_that_hinges_can_break(seed: int) -> None:
    """The pair with the weakest bound may be broken by larger errors than another one: all signs are tried."""
    rng = np.random.default_rng(seed)
    of = as_design(
        random_point(push(5, module=SMALL_AIR, end_effector={"exclusion": False}), random_tree(5, rng), rng)
    )
    found = platform(of)
    scene = Scene(of, found)
    airflow = [r for r in scene.requirements() if r.kind == "airflow"]
    result = sensitivity(Findings(scene, Assembly(), CLEARANCES, airflow, certify(airflow), {}))
    assert result.hinge_angle_deg.violated_at is not None
    broken = []
    still = np.zeros((6, 3))
    for part in (0.98, 1.0001):
        delta, least = part * math.radians(result.hinge_angle_deg.violated_at), math.inf
        for signs in product((-1.0, 1.0), repeat=4):
            turns = delta * np.array(signs)
            moved = deviate(Scene(of), turns=turns, shifts=still, envelope=0.0, mount=None)
            least = min(least, *(clearance_of(r) for r in moved.requirements() if r.kind == "airflow"))
        broken.append(least < 0)
    assert broken == [False, True]


def test_errors_that_turn_the_axis_towards_the_com_make_an_example() -> None:
    """A cone about p_E and the COM: shifting every module across turns it, which one module alone hardly does."""
    rng = np.random.default_rng(13)
    asked = push(
        5,
        exposure=[{"kind": "exterior", "half_angle_deg": 89.0}],
        module=SMALL_AIR,
        end_effector={"exclusion": False},
    )
    of = as_design(random_point(asked, random_tree(5, rng), rng))
    found = platform(of)
    scene = Scene(of, found)
    cones = [r for r in scene.requirements() if r.kind == "exterior"]
    result = sensitivity(Findings(scene, Assembly(), CLEARANCES, cones, certify(cones), {}))
    assert result.position_m.violated_at < 1.5 * result.position_m.tolerated


def test_the_tolerances_of_a_task() -> None:
    fine = {"hinge_angle_deg": 0.2, "position": 1e-3, "envelope": 2e-3}
    clear = audit(fan({"tolerances": fine})).sensitivity
    assert clear.tolerances.status == Status.CLEAR
    assert 0 < clear.tolerances.lower_m <= clear.tolerances.attained_m
    assert clear.tolerances.factor.tolerated > 1
    rough = audit(fan({"tolerances": {"envelope": 0.2}, "flight": {"tolerances": False}}))
    assert rough.verdict == Status.CLEAR  # the verdict is on the design as drawn
    assert rough.tolerances_words.endswith("measured, not required")
    assert rough.sensitivity.tolerances.status == Status.VIOLATED
    assert rough.sensitivity.tolerances.factor.tolerated < 1


def test_a_file_from_before_tolerances_were_required_measures_them() -> None:
    rough = fan({"tolerances": {"envelope": 0.2}})
    stored = rough.model_dump(mode="json")
    assert stored["task"]["flight"]["tolerances"] is True
    for flight in ({}, {"force_reserve": 0.0}):
        older = Design.model_validate({**stored, "task": {**stored["task"], "flight": flight}})
        assert not older.task.flight.tolerances
        assert audit(older).verdict == Status.CLEAR
        assert Design.model_validate_json(to_json(older)) == older
    assert audit(Design.model_validate(stored)).verdict == Status.VIOLATED


def test_tolerances_that_a_task_has_count_for_the_verdict() -> None:
    for errors, verdict in (({"hinge_angle_deg": 0.2}, Status.CLEAR), ({"envelope": 0.2}, Status.VIOLATED)):
        found = audit(fan({"tolerances": errors}))
        assert found.verdict == verdict
        row = next(row for row in found.residuals if row.name == "least clearance within the tolerances")
        assert row.status == verdict
        assert (row.value > 0) == (verdict != Status.CLEAR)


def test_what_is_neither_proven_nor_shown_to_be_lost_is_undecided() -> None:
    known = audit(fan({"tolerances": {"hinge_angle_deg": 1.0}})).sensitivity
    limit = known.hinge_angle_deg
    between = (limit.tolerated + limit.violated_at) / 2
    assert audit(fan({"tolerances": {"hinge_angle_deg": between}})).verdict == Status.UNDECIDED


def test_a_design_that_is_violated_tolerates_nothing() -> None:
    result = audit(fan(hinges=(0.6, -0.6))).sensitivity
    assert result.position_m.tolerated == 0
    assert result.position_m.violated_at == 0


def test_the_ablation_looks_at_distances_alone() -> None:
    result = audit(fan({"search": {"interference": "separation"}}, hinges=(0.6, -0.6))).sensitivity
    assert result.position_m.kind in ("separation", "exclusion")
    assert result.envelope_m is None  # no airflow counts: it may reach as far as it likes


def test_one_module_without_requirements_has_no_clearance_to_lose() -> None:
    one = Topology(((-1, -1, -1),))
    free = {"search": {"body_clearance": False}, "end_effector": {"exclusion": False}}
    assert audit(design(one, free, hinges=())).sensitivity is None
    guarded = audit(design(one, {"search": {"body_clearance": False}}, hinges=())).sensitivity
    assert guarded.hinge_angle_deg is None
    assert guarded.position_m.tolerated == pytest.approx((0.6 - 0.15) / 2, rel=1e-5)
