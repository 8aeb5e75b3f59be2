"""What audits say beyond the task, from the ledger to the answer: columns, near ties, a tampered ledger."""

from dataclasses import replace
from itertools import permutations
from typing import Any

import toy_problem
from processes import table
from report_cases import HOVER, Reader, flight, joint
from toy_problem import toy_row, toy_run
from wording import says

from topo_search.cli.tables import answer_lines
from topo_search.engine import Job
from topo_search.model import Audit, CaseFlight, CasePower, Design, Flight, RotorsOut
from topo_search.model.air import AirSpeeds, CaseAir, RegionAir
from topo_search.report.page import render
from topo_search.report.run_page import run_page
from topo_search.study import COLUMNS, RunFolder
from topo_search.study.answering import _reserve_order

RESERVES = {"a500": 1.25, "a600": 0.5, "aa00": 2.0, "a300": 0.25}
COSTS = {"a500": 2.0, "a600": 2.015, "aa00": 2.019, "a300": 2.03}


def told(key: str) -> Flight:
    """Figures that name their key by the reserve of force."""
    reserve = RESERVES.get(key, 0.1)
    hover = HOVER.model_copy(
        update={
            "force_reserve_N": reserve,
            "horizontal_reserve_N": reserve,
            "torque_reserve_Nm": 0.125,
            "force_reserve_com_N": 0.25,
            "tilt_deg": 7.5,
            "torque_weakest": None,
        }
    )
    return flight(
        cases=(hover, CaseFlight(name="load case 0", possible=True, load_factor=1.25)),
        rotors_out_hover=RotorsOut(survive=11, of=12, lost=((2, 1),)),
        rotors_out_all=RotorsOut(survive=10, of=12, lost=((2, 1), (2, 3))),
        joints=(joint("hover", 1.0, 9.0), joint("load case 0", 1.0, 0.75)),
        hinge_tolerance_deg=0.0625,
        hover_power_ratio=1.0,
        span_m=1.0,
        rod_length_m=0.375,
        rod_mass_share=0.01,
    )


def audit(design: Design) -> Audit:
    flight = told(design.topology.key)
    watts = {"ideal_W": 1.0, "shaft_W": 50 * RESERVES.get(design.topology.key, 0.1), "figure_of_merit": 0.5}
    power = (CasePower(name="hover", **watts), CasePower(name="load case 0", **{**watts, "shaft_W": 99.0}))
    region = RegionAir(name="exposure 0 (local)", speed_m_s=1.0, speed_at_most_m_s=1.25, estimate_m_s=1.0)
    air = AirSpeeds(cases=(CaseAir(name="load case 0", tip_m_s=0.5, tip_estimate_m_s=0.5, regions=(region,)),))
    return toy_problem.audit(design).model_copy(update={"flight": flight, "power": power, "air": air})


def solve(job: Job) -> Any:
    """The toy problem, at costs that are close to each other."""
    found = toy_problem.solve(job)
    share = (COSTS[job.topology.key] / found.objective) ** 0.5
    inputs = [[share * u for u in row] for row in found.rotor_speeds_squared]
    J = sum(u * u for row in inputs for u in row)
    stated = {"rotor_speeds_squared": inputs, "objective": J, "gap": Design.gap_of(J, toy_problem.BOUND)}
    return found.model_validate({**found.model_dump(), **stated})


BACKENDS = replace(toy_problem.BACKENDS, audit=audit, solve=solve)


def test_the_table_of_candidates_has_what_audits_say_beyond_the_task(tmp_path):
    toy_run(tmp_path / "run", backends=BACKENDS)
    flight = COLUMNS[-19:-7]  # the last ones are of proofs and values
    assert flight == (
        *("force_reserve_N", "torque_reserve_Nm", "rotors_out_hover", "load_factor", "joint_moment_Nm"),
        *("hinge_tolerance_deg", "rod_length_m", "power_W", "air_tip_m_s", "air_region_m_s"),
        *("force_reserve_com_N", "tilt_deg"),
    )
    found = table(tmp_path / "run")
    assert set(found) == set(RESERVES)
    for key, row in found.items():
        cells = [row[name] for name in flight]
        values = [RESERVES[key], 0.125, 11, 1.25, 0.75, 0.0625, 0.375, 50 * RESERVES[key], 0.5, 1.25, 0.25, 7.5]
        assert cells == [*map(str, values)]


def test_without_figures_their_cells_are_empty(tmp_path):
    answer = toy_run(tmp_path / "run")
    assert all(not row[name] for row in table(tmp_path / "run").values() for name in COLUMNS[-15:])
    assert answer.weakest_point is None
    assert answer.candidates["force_reserve_N"].isna().all()


def test_figures_outlive_more_starts_and_another_process(tmp_path):
    toy_run(tmp_path / "run", backends=BACKENDS)
    before = table(tmp_path / "run")
    toy_run(tmp_path / "run", backends=BACKENDS, starts=4)
    after = table(tmp_path / "run")
    for key in before:
        assert [before[key][name] for name in COLUMNS[-12:]] == [after[key][name] for name in COLUMNS[-12:]]


def test_designs_that_cost_about_the_same_are_ranked_by_reserve(tmp_path, capsys):
    answer = toy_run(tmp_path / "run", backends=BACKENDS)
    (size,) = answer.sizes
    assert [row.key for row in size.top] == ["a500", "a600", "aa00", "a300"]
    assert [row.key for row in size.near_ties] == ["aa00", "a500", "a600"]
    assert size.near_ties_unaudited == 0
    print(*answer_lines(answer), sep="\n")
    lines = capsys.readouterr().out.splitlines()
    place = next(k for k, line in enumerate(lines) if "designs within 1 % of the least control effort" in line)
    assert [line.split()[0] for line in lines[place + 2 : place + 5]] == ["aa00", "a500", "a600"]
    assert lines[place + 2].split()[1:6] == ["+0.95", "%", "2", "N", "0.125"]
    assert says(lines[-3], "a500: hovers", "1.25 N towards -y", "11 of 12")
    shown = size._repr_html_()
    place = shown.index("within 1 % of the least control effort")
    assert 0 < shown.index("aa00", place) < shown.index("a500", place) < shown.index("a600", place)
    with RunFolder.load(tmp_path / "run") as folder:
        page = Reader(render(run_page(folder)))
    assert says(page.text, "Hovers;", "1.25 N towards -y; survives 11 of 12")
    assert "audited designs within 1 % of the least control effort" in page.text
    assert "Beyond the task" in page.text
    assert says(page.text, "all load cases", "survives 10 of 12, not rotor 1 of module 2")


def test_near_ties_are_ranked_by_force_then_torque_then_effort_and_unknown_reserves_are_last():
    ranked = [
        (2.0, 0.1, 9.0),
        (1.0, 0.3, 9.0),
        (1.0, 0.2, 1.0),
        (1.0, 0.2, 2.0),
        (0.0, None, 1.0),
        (None, 0.9, 1.0),
    ]
    rows = [
        replace(toy_row(f"a{k}", objective=J, gap=0.1), force_reserve_N=force, torque_reserve_Nm=torque)
        for k, (force, torque, J) in enumerate(ranked)
    ]
    for given in permutations(rows):
        assert sorted(given, key=_reserve_order) == rows


def test_a_design_as_near_that_is_not_audited_is_counted(tmp_path, monkeypatch):
    monkeypatch.setattr("topo_search.study.solving.AUDIT_BATCH", 2)
    (size,) = toy_run(tmp_path / "run", backends=BACKENDS).sizes
    assert [row.key for row in size.near_ties] == ["a500", "a600"]
    assert size.near_ties_unaudited == 1
