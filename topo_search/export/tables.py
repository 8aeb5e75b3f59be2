"""Candidates and clearances as data frames, and as files for spreadsheets (CSV) and data tools (Parquet)."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import pandas as pd
from pydantic import BaseModel

from topo_search.model import Audit, Clearance, Residual
from topo_search.model.tables import escape_formula


def clearances(audit: Audit) -> pd.DataFrame:
    """Return a row for every pair and requirement of an audit [m], with the fields of `Clearance`.

    Without evidence and points, which are not single values.
    """
    return _clearances(audit.pairs)


def clearances_of(audits: Sequence[tuple[str, Audit]]) -> pd.DataFrame:
    """Return the clearances of several audits; the last column, `design`, has the name that comes with each."""
    frame = _clearances(pair for _, audit in audits for pair in audit.pairs)
    return frame.assign(design=[name for name, audit in audits for _ in audit.pairs])


def residuals(audit: Audit) -> pd.DataFrame:
    """Return a row for every checked number of an audit, with the fields of `Residual`."""
    return _frame(Residual, audit.residuals).astype({"stated": "float64", "derived": "float64"})


def csv(frame: pd.DataFrame) -> str:
    """Return a data frame as the text of a CSV file; what is not known is left empty, and no text is a formula."""
    texts = frame.select_dtypes(exclude="number").columns
    frame = frame.assign(**{name: frame[name].map(escape_formula) for name in texts})
    return frame.to_csv(index=False, lineterminator="\n")


def parquet(frame: pd.DataFrame) -> bytes:
    """Return a data frame as the content of a Parquet file; ModuleNotFoundError if pyarrow is not installed."""
    import pyarrow  # noqa: F401 (pandas would say in other words that it is missing)

    return frame.to_parquet(None, engine="pyarrow", index=False)


def _clearances(pairs: Iterable[Clearance]) -> pd.DataFrame:
    numbers = dict.fromkeys(("lower_m", "upper_m", "analytic_m", "percent"), "float64")
    frame = _frame(Clearance, pairs).astype({**numbers, "segment": "Int64"})
    return frame.drop(columns=["evidence", "closest_m"])


def _frame(kind: type[BaseModel], values: Iterable[BaseModel]) -> pd.DataFrame:
    return pd.DataFrame([value.model_dump(mode="json") for value in values], columns=list(kind.model_fields))
