"""Every figure that is printed as proven is on the side on which it is proven, wherever it is printed.

Random values go through all places that print them; a number in a text is taken for a value that is near it.
"""

import re
from fractions import Fraction

import numpy as np
import pandas as pd
import pytest
from commands import invoke
from nlp_cases import hover
from report_cases import design, flight
from toy_problem import toy_row

from nlp import prove_impossible
from topo_search import compose
from topo_search.cli.tables import _front, _rows, audit_lines
from topo_search.compose import audit
from topo_search.compose.asking import expectations
from topo_search.compose.designs import compare_audits
from topo_search.export.audits import summary_lines
from topo_search.model import CaseFlight, Clearance, Limit, ShorterRod, Topology
from topo_search.model.goals import Level
from topo_search.model.objective import LEAST_EFFORT
from topo_search.model.proven import excess_texts
from topo_search.model.relaxed import Relaxation
from topo_search.model.sensitivity import WorstCase
from topo_search.report.charts import clearance_matrices
from topo_search.report.design_page import bound
from topo_search.report.design_part import cases, errors, findings, flight_sentences, nearest, residuals
from topo_search.report.headline import ranking
from topo_search.report.run_page import front_part
from topo_search.report.wording import near_tie_cells
from topo_search.study import Answer, FrontPoint
from topo_search.study.answer import LevelAnswer
from topo_search.study.ledger import Row
from topo_search.study.proofs import ProofState, problem
from topo_search.study.proving import Checked, CheckedTree

UNITS = {"mm": 1e-3, "cm": 1e-2}
RAISED = str.maketrans("⁻⁰¹²³⁴⁵⁶⁷⁸⁹", "-0123456789")
NUMBER = re.compile(r"(?<![\w.])([-−]?\d+(?:\.\d+)?(?:e[-+]?\d+)?)(?: × 10([⁻⁰¹²³⁴⁵⁶⁷⁸⁹]+))?(?:\s(mm|cm)\b)?")


def near(text: object, value: float, scale: float = 1.0) -> list[Fraction]:
    """Return the numbers in a text that are within a tenth of a value, which is printed `scale` times as large."""
    found = []
    for digits, power, unit in NUMBER.findall(str(text)):
        number = Fraction(digits.replace("−", "-")) * Fraction(10) ** int((power or "0").translate(RAISED))
        found.append(number * Fraction(str(UNITS.get(unit, 1))) / Fraction(str(scale)))
    return [number for number in found if abs(number - Fraction(value)) <= abs(Fraction(value)) / 10]


def check(text: object, *, least: float | None = None, most: float | None = None, scale: float = 1.0) -> None:
    """Require that a text has a number for each of the values, and none on its wrong side."""
    for value, sign in ((least, 1), (most, -1)):
        if value is not None:
            numbers = near(text, value, scale)
            slack = abs(Fraction(value)) / 10**14  # of fifteen digits, which is all that a double is sure of
            assert numbers, (value, text)
            assert all(sign * (Fraction(value) - number) >= -slack for number in numbers), (value, numbers, text)


@pytest.fixture(scope="module")
def audited():
    made = design(Topology.from_key("a300"))
    return made, audit(made)


def draws(count: int, low: float = 1e-4, high: float = 0.1) -> list[float]:
    return np.exp(np.random.default_rng(7).uniform(np.log(low), np.log(high), count)).tolist()


@pytest.mark.parametrize("status", ["clear", "violated", "undecided"])
def test_clearances(audited, status, capsys):
    made, found = audited
    for x in draws(8):
        least = -x if status == "violated" else x
        pair = Clearance(
            kind="airflow", a=0, b=1, status=status, lower_m=least, upper_m=3 * least, analytic_m=least, level=0
        )
        only = found.model_copy(update={"pairs": (pair,), "sensitivity": None, "flight": None, "residuals": ()})
        print(*audit_lines("mine", only), sep="\n")
        _, figure = next(clearance_matrices(made, only))
        rows, pointed = nearest(only.pairs).rows, figure["data"][0]["customdata"]
        for text in (
            capsys.readouterr().out,
            compare_audits(only, only),
            [cell for row in rows for cell in row],
            only._repr_html_(),
            pointed,
        ):
            check(text, least=least)
        for text in (rows[0][4], only._repr_html_(), pointed):
            check(text, most=3 * least)


def test_errors_that_are_harmless_and_what_is_not_met(audited, capsys):
    made, found = audited
    for x in draws(8):
        limit = Limit(kind="airflow", a=0, b=1, segment=None, tolerated=x, violated_at=3 * x)
        worst = WorstCase(
            kind="airflow", a=0, b=1, segment=None, status="clear", lower_m=x, attained_m=3 * x, factor=None
        )
        limits = {"hinge_angle_deg": limit, "position_m": limit, "envelope_m": limit, "tolerances": worst}
        row = found.residuals[0].model_copy(
            update={"value": 9 * x, "scaled": 27 * x, "tolerance": 81 * x, "status": "violated"}
        )
        changed = found.model_copy(
            update={
                "sensitivity": found.sensitivity.model_copy(update=limits),
                "pairs": (),
                "flight": None,
                "air": None,
                "residuals": (row,),
                "interference": None,
            }
        )
        print(*audit_lines("mine", changed, details=True), sep="\n")
        printed, checked = capsys.readouterr().out, residuals(changed).rows[0]
        for text in (printed, *errors(changed).rows, findings(made, changed)):
            check(text, least=x, most=3 * x)
        for text in (printed, checked, changed._repr_html_()):
            check(text, most=9 * x)
        check(checked, least=81 * x, most=27 * x)


def test_flights_fronts_and_near_ties(audited, capsys):
    for x in draws(25, 1e-2, 0.28):
        case = CaseFlight(
            name="hover",
            possible=True,
            force_reserve_N=x,
            horizontal_reserve_N=x,
            torque_reserve_Nm=x,
            torque_weakest=(0.0, 0.0, 1.0),
            load_factor=1 + x,
            largest_input=3 * x,
            least_input=x,
        )
        found = flight(cases=(case,))
        check(found.weakest_point, least=x)
        briefly = list(summary_lines(audited[1].model_copy(update={"flight": found})))
        check(briefly[1], least=x)
        check(briefly[3], least=1 + x)
        check(flight_sentences(found)[1:], least=x)
        check(cases(found).rows[0], least=x, most=3 * x)
        row = Row(
            *("a300", 3, 1, "feasible"),
            objective=1e9,
            force_reserve_N=x,
            joint_moment_Nm=3 * x,
            hinge_tolerance_deg=x,
            audit="clear",
        )
        check(near_tie_cells(row, "", 12)[2:], least=x, most=3 * x)
        point = FrontPoint(row, x, x, 3 * x, 0, Level(*[None] * len(Level._fields)), joint_moment=9 * x)
        answer = Answer("nowhere", (), (LevelAnswer(0, point.level, ()),), (point,))
        print(*_front(answer), sep="\n")
        printed = capsys.readouterr().out.splitlines()[3]
        for text in (printed, front_part(answer, [])["designs"].rows[0], answer._repr_html_()):
            check(text, least=x, most=3 * x)


def test_efforts_and_gaps(capsys, monkeypatch):
    for x in draws(25, 1e13, 1e15):
        candidate = toy_row("a300", objective=x, gap=0.1), ProofState(x, 0.1, "task", "within"), None
        check(ranking([candidate], LEAST_EFFORT, proofs=True)["candidates"]["rows"][0][-3:], least=x)
        check(bound(x, 0.1, hover(3))[0], least=x)
        size = {
            "modules": 3,
            "candidates": 3,
            "quotient": "",
            "impossible": None,
            "lower_bound": x,
            "defaults_share": None,
        }
        check([words for _, words in expectations([size])], least=x)
        row = toy_row("a300", objective=x, gap=0.1)
        print(*_rows((row,), LEAST_EFFORT), sep="\n")
        check(capsys.readouterr().out.splitlines()[1].split()[2], most=x / row.lower_bound)
        checked = Checked(trees=[CheckedTree("a300", 3, bound=x)])
        monkeypatch.setattr(compose, "check_proofs", lambda *_, given=checked, **__: given)
        check(invoke("prove", "run", "--check").stdout, least=x)
        proof = {"proven_bound": x, "proven_gap": 0.1, "proof": "excluded", "proven_problem": "task"}
        table = pd.DataFrame([{"key": "a300", "modules": 3, "objective": x, **proof}])
        monkeypatch.setattr(compose, "prove", lambda *_, **__: Answer("nowhere", ()))
        monkeypatch.setattr("topo_search.study.tables.candidates", lambda _, given=table: given)
        check(invoke("prove", "run", status=4).stdout, least=x)


def test_what_is_enough_is_not_rounded_to_what_is_not():
    for x in draws(25):
        one = Relaxation(
            topology_key="a300", limit="", change="", field="module.mass", share=0.1, given=9 * x, enough=x
        )
        check(one.words.split(" to ")[1], least=x)
        check(one.model_copy(update={"given": x / 9}).words.split(" to ")[1], most=x)


def test_reasons_why_nothing_can_do_a_task():
    for x in draws(12, 0.6, 3.0):
        reach = hover(2, end_effector={"stand_off": x, "largest_reach": 0.1})
        message = prove_impossible(reach).message
        check(message.split("so that")[-1], least=x - reach.module.connector_distance)
        check(message, most=0.1)


def test_the_scope_of_a_proof():
    for x in draws(25, 0.1, 1.0):
        task = hover(3, search={"interference": "separation", "separation": x}).resolve(3)
        check(problem(task, "task"), most=x)


@pytest.mark.parametrize(("cost", "side"), [(0.0123, "most"), (None, "least")])
def test_what_a_shorter_rod_costs(cost, side):
    for length in (0.23456, 0.23444):
        check(ShorterRod(length_m=length, cost=cost).words, **{side: length})


def test_a_needed_and_an_available_amount_stay_apart():
    rng = np.random.default_rng(3)
    for _ in range(500):
        below = float(np.exp(rng.uniform(-7, 7)))
        above = below * (1 + 10.0 ** rng.uniform(-9, 0))
        more, less = map(Fraction, excess_texts(above, below))
        assert (
            Fraction(below) * (1 - Fraction(1, 10**14))
            <= less
            < more
            <= Fraction(above) * (1 + Fraction(1, 10**14))
        )
    assert excess_texts(0.85006, 0.5) == ("0.85", "0.5")
