"""Proven numbers are rounded to the side on which they are still proven, the same wherever they are shown."""

import re
from decimal import Decimal
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st
from report_cases import design
from toy_problem import toy_row

from topo_search.cli.tables import progress_line
from topo_search.compose import audit
from topo_search.model import Limit, Status, Topology
from topo_search.model.proven import SOLVER_PRECISION, at_least, at_most, gap_percent
from topo_search.report.charts import clearance_matrices
from topo_search.report.design_page import bound, design_page
from topo_search.report.design_part import errors, nearest
from topo_search.report.progress import describe
from topo_search.study.answering import statement

PUSH = 0.088938
"""A gap of 8.89 % to the nearest, of which 8.90 % are proven."""


@given(st.floats(1e-300, 1e300), st.integers(1, 9))
def test_a_rounded_number_is_on_its_side_and_as_near_as_its_digits_allow(value: float, digits: int) -> None:
    below, above = at_least(value, digits), at_most(value, digits)
    slack = value * 1e-14  # of fifteen digits, which is all that a double is sure of
    assert below <= value + slack
    assert above >= value - slack
    assert above - below <= 1.001 * 10.0 ** (1 - digits) * above
    assert (at_least(-value, digits), at_most(-value, digits)) == (-above, -below)
    for rounded in (below, above):
        assert at_least(rounded, digits) == at_most(rounded, digits) == rounded


@given(st.floats(0, 1), st.integers(0, 4))
def test_a_gap_is_never_told_smaller(gap: float, decimals: int) -> None:
    told = Decimal(gap_percent(gap, decimals).removesuffix(" %"))
    if gap > SOLVER_PRECISION:
        assert 0 <= Fraction(told) - 100 * Fraction(gap) + Fraction(1, 10**9) <= Fraction(1, 10**decimals) + 1
        assert Fraction(told) >= 100 * Fraction(gap) - Fraction(1, 10**9)
    else:
        assert told == 0


@pytest.mark.parametrize(
    ("gap", "told"),
    [
        (1e-7, "0.00 %"),
        (2e-6, "0.01 %"),
        (0.088901, "8.90 %"),
    ],
)
def test_rounding_of_the_arithmetic_is_no_part_of_a_gap(gap: float, told: str) -> None:
    assert gap_percent(gap) == told


def test_one_answer_has_one_figure() -> None:
    made = design(Topology.from_key("af0000"), gap=PUSH, objective=2.5e14, lower_bound=2.5e14 * (1 - PUSH))
    row = toy_row("a70010", objective=made.objective, gap=PUSH)
    told = [statement(row, 28, 28), describe(row), progress_line(made), made._repr_html_()]
    page = design_page(made, audit(made).model_copy(update={"verdict": Status.CLEAR}), "mine.json")
    told += page["bound"][1:2]
    told += [tile.figure for tile in page["tiles"] if tile.name == "Proven gap"]
    assert len(told) == 6
    assert {found for text in told for found in re.findall(r"[\d.]+ %", text)} == {"8.90 %"}


def test_the_lower_bound_is_told_rounded_down() -> None:
    assert "2.331 × 10¹⁴" in bound(2.33109e14, 0.1, design(Topology.from_key("a300")).task)[0]


def test_bounds_of_clearances_and_errors_are_told_on_their_side() -> None:
    made = design(Topology.from_key("a300"))
    found = audit(made)
    pair = found.pairs[0].model_copy(
        update={"status": "undecided", "lower_m": 0.00123456, "upper_m": 0.00123411, "analytic_m": -1.0}
    )
    limit = Limit(kind="airflow", a=0, b=1, segment=None, tolerated=0.0040999, violated_at=0.0041001)
    changed = found.model_copy(
        update={"pairs": (pair,), "sensitivity": found.sensitivity.model_copy(update={"hinge_angle_deg": limit})}
    )
    assert nearest(changed.pairs).rows[0][3:] == ["1.23 mm", "1.24 mm"]
    _, figure = next(clearance_matrices(made, changed))
    pointed = figure["data"][0]["customdata"]
    assert "proven: 1.23 mm to 1.24 mm" in str(pointed)
    assert errors(changed).rows[0][1:3] == ["0.00409°", "0.00411°"]
