"""Tables of candidates and clearances: columns of the right types, and files that read back the same."""

import io

import pandas as pd
import pyarrow.parquet
import pytest
from toy_problem import toy_run
from verify_cases import changed, fan

from topo_search.export import audits as tables
from topo_search.export.audits import clearances, parquet, residuals
from topo_search.model import Audit, Residual
from topo_search.study import COLUMNS
from verify import audit

CLEARANCE = ("kind", "a", "b", "segment", "status", "lower_m", "upper_m", "analytic_m", "level", "percent", "rotor")


@pytest.fixture(scope="module")
def audited() -> Audit:
    """A design that is clear but for its objective, with regions of every kind."""
    exposure = [
        {"kind": "directional", "radius": 0.05, "segments": [[0.0, 0.0, 1.0], [0.0, 0.5, 1.0]]},
        {"kind": "local", "radius": 0.05},
    ]
    return audit(changed(fan({"exposure": exposure}), objective=1.0))


def test_a_row_for_every_clearance(audited: Audit) -> None:
    frame = clearances(audited)
    assert tuple(frame.columns) == CLEARANCE
    assert len(frame) == len(audited.pairs)
    paths = frame[frame.kind == "directional"]
    assert sorted(zip(paths.a, paths.segment, strict=True)) == [(a, k) for a in range(3) for k in range(2)]
    assert set(frame[frame.kind == "rotor-airflow"].segment.dropna()) == {0, 1, 2, 3}
    assert frame[~frame.kind.isin(["directional", "rotor-airflow"])].segment.isna().all()
    assert frame.analytic_m.min() == min(pair.analytic_m for pair in audited.pairs)
    assert (frame.lower_m <= frame.analytic_m).all()
    assert (frame.analytic_m <= frame.upper_m + 1e-12).all()


def test_a_row_for_every_residual(audited: Audit) -> None:
    frame = residuals(audited)
    assert tuple(frame.columns) == tuple(Residual.model_fields)
    assert list(frame[frame.status == "violated"].stated) == [1.0]


def test_files_read_back_as_they_were(audited: Audit) -> None:
    frame = clearances(audited)
    pd.testing.assert_frame_equal(pd.read_parquet(io.BytesIO(parquet(frame))), frame, check_dtype=False)
    again = pd.read_csv(io.StringIO(tables.csv(frame)), dtype={"segment": "Int64", "rotor": "Int64"})
    pd.testing.assert_frame_equal(again, frame, check_dtype=False, rtol=1e-14)


def test_parquet_files_of_all_runs_have_the_same_columns(tmp_path, monkeypatch) -> None:
    """Whether or not any candidate has a constraint, an audit or a proof."""
    monkeypatch.setenv("TOY_NONE", "aa00")
    frame = toy_run(tmp_path / "run", modules=(2, 3)).candidates
    rows = (
        frame,
        *(frame[frame.status == status] for status in ("feasible", "infeasible")),
        frame.assign(audit=None),
    )
    schema, *others = (pyarrow.parquet.read_schema(io.BytesIO(parquet(each))) for each in rows)
    assert all(other.equals(schema) for other in others)
    assert "null" not in map(str, schema.types)


def test_the_candidates_of_an_answer_are_those_of_its_file(tmp_path, monkeypatch) -> None:
    monkeypatch.setenv("TOY_NONE", "aa00")
    frame = toy_run(tmp_path / "run", modules=(2, 3)).candidates
    assert tuple(frame.columns) == COLUMNS
    said = ["proof", "proven_problem"]
    read = pd.read_csv(tmp_path / "run" / "candidates.csv", dtype=dict.fromkeys(said, object))
    read[said] = read[said].where(read[said].notna(), None)  # nothing is proven: empty columns
    pd.testing.assert_frame_equal(frame, read, check_dtype=False, rtol=1e-14)
    assert tables.csv(frame) == (tmp_path / "run" / "candidates.csv").read_text()
    assert set(frame.status) == {"feasible", "infeasible"}
    assert frame.objective.dtype == frame.violation.dtype == float
