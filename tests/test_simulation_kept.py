"""The flights that the documentation shows: of the designs that they name, as flown today, as claimed of them."""

from pathlib import Path

import pandas as pd
import pytest
from suites import few

from nlp import lower_bound
from topo_search.model import Design
from topo_search.model.files import read_json
from topo_search.model.task_file import read_task
from topo_search.simulation.campaign import fly_all
from topo_search.simulation.fly import Options
from topo_search.simulation.result import FlightResult, digest_of

ROOT = Path(__file__).parents[1]
HELD = ("flying/wall-push", "flying/window-cleaning", "flying/survives-a-rotor")
FAILING = ("push-a70010", "wall-push-without-reserves")


def kept(name: str) -> tuple[Design, FlightResult]:
    design = read_json(Design, ROOT / f"tests/designs/{name}.json")
    return design, read_json(FlightResult, ROOT / f"notebooks/results/flight-{Path(name).name}.json")


@pytest.mark.parametrize("name", [*HELD, *FAILING])
def test_they_are_of_their_designs_and_of_this_simulation(name: str) -> None:
    design, told = kept(name)
    assert told.design == digest_of(design)
    (again,) = fly_all(design, Options(), only=("return from +y",)).result.scenarios
    (before,) = (one for one in told.scenarios if one.name == again.name)
    assert again.outcome == before.outcome
    assert again.drift_m == pytest.approx(before.drift_m, rel=0.05, abs=1e-4)
    assert again.saturated_share == pytest.approx(before.saturated_share, abs=0.01)


@pytest.mark.parametrize("name", HELD)
def test_designs_of_examples_come_back_stand_still_push_and_survive(name: str) -> None:
    design, told = kept(name)
    by_name = {one.name: one for one in told.scenarios}
    assert by_name["hover"].drift_m < 0.01
    assert all(by_name[f"return from {side}"].settled_s < 3 for side in ("+x", "+y", "-x", "-y"))
    pushes = [one for one in told.scenarios if one.counts and one.force_error_share is not None]
    solid = any(region.solid for region in design.task.exposure)
    assert any(one.name.endswith("wall") for one in pushes) == solid
    assert all(one.force_error_share < 0.05 for one in pushes)
    assert all((one.saturated_share or 0.0) <= 0.05 for one in told.scenarios if one.counts)
    dies = told.scenarios[-1]
    assert (dies.name.endswith("dies"), dies.counts, dies.outcome) == (True, True, "recovered")
    assert told.verdict == "held"


@pytest.mark.parametrize("name", FAILING)
def test_designs_without_reserves_fail_and_the_table_says_why(name: str) -> None:
    _, told = kept(name)
    assert told.verdict == "not held"
    back = [one for one in told.scenarios if one.name.startswith("return")]
    assert any(one.verdict == "not held" and "rotors could not produce" in one.reason for one in back)
    assert told.weakest_force_share < 0.02


FLOWN = [
    tuple(row)
    for row in pd.read_csv(ROOT / "notebooks/results/flights.csv")[["task", "modules", "required", "effort"]].values
]


@pytest.mark.parametrize(
    ("task", "n", "required", "effort"), few(FLOWN, [row for row in FLOWN if row[1] == 3 and row[2] == "task"][:1])
)
def test_no_flown_design_costs_less_than_the_bound_of_the_task_that_its_row_names(
    task: str, n: int, required: str, effort: float
) -> None:
    shipped = ROOT / f"tests/designs/{task}.toml" if required == "reserves" else task
    bound = lower_bound(read_task(shipped, (f"modules={n}",)).resolve(n))
    assert effort >= 0.999 * bound  # efforts are rounded to four digits
