"""Accuracy of what is proven: required of a design, and kept where a number is rounded for a reader.

Audit and proofs require the same accuracy, so that they agree. A proven number is rounded to the side on which it
is still proven: every proven figure is printed by way of `at_least` or `at_most`.

| symbol | meaning | unit |
|---|---|---|
| J | control effort of a design | rad^4/s^4 |
| gap | 1 - lower bound / J: the share of J that another design can save at most | |
"""

from __future__ import annotations

import sys
from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal

SOLVER_PRECISION = 1.0e-6
"""Relative error of an objective that the solver does not care about: efforts that differ by no more are equal."""


def at_least(value: float, digits: int) -> float:
    """Return a number with so many significant digits that is not larger."""
    return _round(value, digits, ROUND_FLOOR)


def at_most(value: float, digits: int) -> float:
    """Return a number with so many significant digits that is not smaller."""
    return _round(value, digits, ROUND_CEILING)


def lower_text(value: float, digits: int = 6) -> str:
    """Return a proven lower bound in so many significant digits, rounded down.

    >>> lower_text(2.9999e15, 3)
    '2.99e+15'
    """
    return f"{at_least(value, digits):.{digits}g}"


def upper_text(value: float, digits: int = 6) -> str:
    """Return a proven upper bound in so many significant digits, rounded up.

    >>> upper_text(2.9901e15, 3)
    '3e+15'
    """
    return f"{at_most(value, digits):.{digits}g}"


def excess_texts(above: float, below: float, digits: int = 4) -> tuple[str, str]:
    """Return `above`, rounded down, and `below`, rounded up, with enough digits to show which is larger."""
    while digits < sys.float_info.dig and at_least(above, digits) <= at_most(below, digits):
        digits += 1
    return lower_text(above, digits), upper_text(below, digits)


def gap_percent(gap: float, decimals: int = 2) -> str:
    """Return in percent how much better another design can be at most; zero if by no more than rounding.

    >>> gap_percent(0.01541)
    '1.55 %'
    """
    certain = 10  # decimals of a percentage that the arithmetic which led to it leaves certain
    percent = Decimal(f"{100 * gap if gap > SOLVER_PRECISION else 0.0:.{certain}f}")
    return f"{percent.quantize(Decimal(1).scaleb(-decimals), ROUND_CEILING)} %"


def improvement(gap: float) -> str:
    """Return in words how much better another design can be at most; `better` if by no more than rounding."""
    return f"more than {gap_percent(gap)} better" if gap > SOLVER_PRECISION else "better"


def _round(value: float, digits: int, rounding: str) -> float:
    return float(Context(prec=digits, rounding=rounding).create_decimal(f"{value:.{sys.float_info.dig}g}"))


TOLERANCE = 1e-6
"""Largest deviation of a clear design, in units of its scale.

Forces in m_t g; torques in l_arm m_t g, about the COM and about p_E; inputs in the largest allowed one; lengths in
l_arm; the objective relative to itself; angles in rad.
"""
FARTHEST_TIP = 100.0
"""Farthest that p_E may be from the COM, in lengths of the platform stretched out.

Far beyond, the COM itself is far from every rotor, and forces within the tolerance make up for torques.
"""
