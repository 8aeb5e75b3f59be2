"""Accuracy of proven numbers, and their rounding for a reader.

Audit and proofs use the same tolerance, so that they agree. A proven number is rounded to the safe side: every one
is printed with `at_least` or `at_most`.

| symbol | meaning | unit |
|---|---|---|
| J | control effort of a design | rad^4/s^4 |
| gap | 1 - lower bound / J: largest share of J that another design can save | |
"""

import sys
from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal

NOT_CERTIFIED = "stated by the user, not certified"
"""Words for a claim without proof."""
SOLVER_PRECISION = 1.0e-6
"""Relative precision of the solver's objective: efforts that differ by less count as equal."""


def at_least(value: float, digits: int) -> float:
    """Round a number down to a number of significant digits."""
    return _round(value, digits, ROUND_FLOOR)


def at_most(value: float, digits: int) -> float:
    """Round a number up to a number of significant digits."""
    return _round(value, digits, ROUND_CEILING)


def lower_text(value: float, digits: int = 6) -> str:
    """Return a proven lower bound as text, rounded down to a number of significant digits.

    >>> lower_text(2.9999e15, 3)
    '2.99e+15'
    """
    return f"{at_least(value, digits):.{digits}g}"


def upper_text(value: float, digits: int = 6) -> str:
    """Return a proven upper bound as text, rounded up to a number of significant digits.

    >>> upper_text(2.9901e15, 3)
    '3e+15'
    """
    return f"{at_most(value, digits):.{digits}g}"


def excess_texts(above: float, below: float, digits: int = 4) -> tuple[str, str]:
    """Return `above`, rounded down, and `below`, rounded up, with enough digits to tell them apart."""
    while digits < sys.float_info.dig and at_least(above, digits) <= at_most(below, digits):
        digits += 1
    return lower_text(above, digits), upper_text(below, digits)


def gap_percent(gap: float, decimals: int = 2) -> str:
    """Return a gap in percent, rounded up; zero within the solver's precision.

    >>> gap_percent(0.01541)
    '1.55 %'
    """
    certain = 10  # decimals of the percentage that rounding errors do not affect
    percent = Decimal(f"{100 * gap if gap > SOLVER_PRECISION else 0.0:.{certain}f}")
    return f"{percent.quantize(Decimal(1).scaleb(-decimals), ROUND_CEILING)} %"


def improvement(gap: float) -> str:
    """Return the comparative in "no topology is ...": `more than GAP better`, or `better` for a zero gap."""
    return f"more than {gap_percent(gap)} better" if gap > SOLVER_PRECISION else "better"


def _round(value: float, digits: int, rounding: str) -> float:
    return float(Context(prec=digits, rounding=rounding).create_decimal(f"{value:.{sys.float_info.dig}g}"))


TOLERANCE = 1e-6
"""Largest deviation of a clear design, scaled.

Scales: forces m_t g; torques l_arm m_t g, about the COM and about p_E; inputs the largest allowed one; lengths
l_arm; the objective its own value; angles 1 rad.
"""
FARTHEST_TIP = 100.0
"""Largest distance of p_E from the COM [lengths of the stretched-out platform].

Farther out, force errors within the tolerance have lever arms that make up for whole torques.
"""
