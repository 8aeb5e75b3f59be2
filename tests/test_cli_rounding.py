"""Proven figures that commands print lie on the safe side of the values in their `--json`.

Each line is named by its words, and must be there; a figure is the number behind them.
"""

import json
import math
import re
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from commands import invoke
from test_cli_prove import check as check_proofs
from test_cli_prove import prove
from test_study_checking import Checker
from test_study_proving import Prover
from test_verify_vehicle import star
from toy_problem import toy_run

from topo_search.cli.run import answer_as_json
from topo_search.cli.tables import answer_lines
from topo_search.model.design import ShorterRod

DESIGNS = Path(__file__).parent / "designs"
Figure = tuple[str, float, str]
"""Words before a number, its value, and whether that is proven as the `least` or the `most`."""


def compare(text: str, figures: Iterator[Figure]) -> int:
    """Require each number on its side of the value, and within a hundredth of it; return how many are no equals."""
    rounded = 0
    for words, value, side in figures:
        match = re.search(words + r"\s*([-+]?\d[\d.]*(?:e[-+]?\d+)?)", text)
        assert match, (words, text)
        above = Fraction(match[1]) - Fraction(value)
        slack = abs(Fraction(value)) / 10**14  # of fifteen digits, which is all that a double is sure of
        assert (above if side == "most" else -above) >= -slack, (words, match[1], value)
        assert abs(above) <= abs(Fraction(value)) / 100 + Fraction(1, 10**9), (words, match[1], value)
        rounded += abs(above) > slack
    return rounded


def run_both(*words: str) -> tuple[str, Any]:
    """Return what a command prints, and its JSON."""
    text, data = (invoke(*words, *more) for more in ([], ["--json"]))
    assert text.exit_code == data.exit_code < 2, text.output
    return text.stdout, json.loads(data.stdout)


def flight_figures(flight: dict[str, Any]) -> Iterator[Figure]:
    hover = flight["cases"][0]
    yield "weakest side force at the tip", hover["horizontal_reserve_N"], "least"
    yield "smallest torque reserve in hover:", hover["torque_reserve_Nm"], "least"
    yield "at the centre of mass in hover:", hover["force_reserve_com_N"], "least"
    yield "at any tilt up to", hover["tilt_deg"], "least"
    yield "centre of mass off by up to", 1e3 * hover["com_error_m"], "least"
    for number, acceleration in enumerate(hover.get("angular_acceleration_rad_s2", ())):
        yield r"angular acceleration in hover, about x, y and z:" + r" \S+" * number, acceleration, "least"
    yield "alone, in hover: side force of", hover["horizontal_reserve_N_pseudo_inverse"], "least"
    yield "N at the tip and", hover["horizontal_reserve_com_N_pseudo_inverse"], "least"
    yield "mass, tilt of", hover["tilt_deg_pseudo_inverse"], "least"
    factors = [case["load_factor"] for case in flight["cases"] if case["load_factor"] is not None]
    yield "until a rotor saturates:", min(factors), "least"
    loads = [load for load in flight["joints"] if load["case"] != hover["name"]]
    if loads:
        worst = max(loads, key=lambda load: load["moment_Nm"])
        yield "largest moment in a joint:", worst["moment_Nm"], "most"
        yield "largest moment in a joint: .* N m and", worst["force_N"], "most"


def audit_figures(audit: dict[str, Any]) -> Iterator[Figure]:
    yield "smallest clearance", min(pair["analytic_m"] for pair in audit["pairs"]), "least"
    for words, name in (("angles", "hinge_angle_deg"), ("positions", "position_m"), ("reach", "envelope_m")):
        limit = audit["sensitivity"][name]
        yield rf"{words}.* by", limit["tolerated"], "least"
        yield rf"{words}.* by .*too much:", limit["violated_at"], "most"
    yield from flight_figures(audit["flight"])
    cases = audit["air"]["cases"]
    yield "air at the tip:", max(case["tip_m_s"] for case in cases), "most"
    for number, region in enumerate(cases[0]["regions"]):
        fastest = max(case["regions"][number]["speed_at_most_m_s"] for case in cases)
        yield rf"air over {re.escape(region['name'])}: at most", fastest, "most"


def airflow_figures(found: dict[str, float]) -> Iterator[Figure]:
    for words, name, side in (
        ("start_radius =", "start_radius_m", "most"),
        ("spread_angle_deg =", "spread_angle_deg", "most"),
        ("reach =", "reach_m", "most"),
        ("a volume of", "volume_m3", "most"),
        ("none is below", "least_volume_m3", "least"),
        ("side", "side_m_s", "most"),
        ("side, merged", "side_merged_m_s", "most"),
        ("far end", "end_m_s", "most"),
        ("rotor plane", "rotor_plane_m_s", "most"),
    ):
        yield words, found[name], side


@pytest.mark.parametrize("name", ["survives-a-rotor", "small-force"])
def test_audit(name: str) -> None:
    text, audit = run_both("audit", str(DESIGNS / f"{name}.json"))
    assert compare(text, audit_figures(audit)) > 9


@pytest.mark.parametrize("words", ["--speed 2", "push-local --speed 3.3 --at full"])
def test_airflow(words: str) -> None:
    text, found = run_both("airflow", *words.split())
    assert compare(text, airflow_figures(found)) > 5


@pytest.mark.parametrize("tilt_deg", [20.0, 36.0])
def test_capability(tmp_path: Path, tilt_deg: float) -> None:
    rotors = star(math.radians(tilt_deg)).model_dump()["rotors"]
    pd.DataFrame(rotors).assign(u_max=4.1, k_tau=0.02).to_csv(tmp_path / "rotors.csv", index=False)
    text, found = run_both("capability", str(tmp_path / "rotors.csv"))
    figures = [
        ("forces without torque:", found["zero_torque_ball_N"], "least"),
        ("a volume of", found["zero_torque_volume_N3"], "least"),
        *flight_figures(found["flight"]),
    ]
    assert compare(text, iter(figures)) > 5


def test_run_prove_and_check(tmp_path: Path, log: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    answer = toy_run(run := tmp_path / "run")
    capsys.readouterr()
    print(*answer_lines(answer), sep="\n")
    (size,) = answer_as_json(answer, ())["sizes"]
    figures = []
    for row in size["top"]:
        figures.append((rf"{row['key']} +\S+", row["objective"] / row["lower_bound"], "most"))
        figures.append((rf"{row['key']} +\S+ +\S+", 100 * row["gap"], "most"))
    figures.append(("gap to the lower bound", 100 * size["best"]["gap"], "most"))
    assert compare(capsys.readouterr().out, iter(figures)) > 5
    proven, data = (prove(monkeypatch, Prover(), run, *more).stdout for more in ([], ["--json"]))
    rows = json.loads(data)["candidates"]
    assert compare(proven, ((f"{r['key']}: .*, J >=", r["proven_bound"], "least") for r in rows)) > 0
    checked, data = (check_proofs(monkeypatch, Checker(), run, *more).stdout for more in ([], ["--json"]))
    trees = json.loads(data)["trees"]
    assert compare(checked, ((f"{t['key']}: .*, J >=", t["bound"], "least") for t in trees)) > 0


def test_check() -> None:
    text, found = run_both("check", "push", "--modules", "3")
    (size,) = found["sizes"]
    shown = re.search(r"at least ([\d.]+) × 10¹⁴", text)
    assert shown
    assert Fraction(shown[1]) * 10**14 <= Fraction(size["lower_bound"]) < Fraction(shown[1]) * 10**14 * 1.01


@pytest.mark.parametrize(("cost", "side"), [(0.0123, "most"), (None, "least")])
def test_what_a_shorter_rod_costs(cost: float | None, side: str) -> None:
    for length in (0.23456, 0.23444, 1.23456):
        words = ShorterRod(length_m=length, cost=cost).words
        assert compare(words, iter([("rod of at most", length, side)])) == 1
