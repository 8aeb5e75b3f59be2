"""Cases of a parametrisation in the fast suite; `make test-slow` runs all of them."""

from collections.abc import Collection, Iterable
from typing import Any

import pytest


def few(cases: Iterable[Any], fast: int | Collection[Any]) -> list[Any]:
    """All cases for a parametrisation, marked slow except the first `fast`, or those in `fast`."""
    listed = list(cases)
    kept = listed[:fast] if isinstance(fast, int) else fast
    return [one if one in kept else _slow(one) for one in listed]


def _slow(case: Any) -> Any:
    return pytest.param(*(case if isinstance(case, tuple) else (case,)), marks=pytest.mark.slow)
