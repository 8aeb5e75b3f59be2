"""Flights: a design with reserves holds, one without fails, and the table says why."""

import csv
import io
import json
import os
import subprocess
import sys
from dataclasses import replace
from functools import partial
from typing import Literal

import numpy as np
import pytest
from commands import invoke
from export_cases import random_design
from PIL import Image
from scipy.optimize import lsq_linear
from suites import few

from topo_search.model import BadInput, Design, LoadCase, Topology, Wrench
from topo_search.model.files import to_json
from topo_search.model.load_case import ForceCone, objects
from topo_search.model.reserves import AskedFlight
from topo_search.simulation import files
from topo_search.simulation.campaign import CORNERS, describe_losses, fly_all, plan, worst_wakes
from topo_search.simulation.fly import Options, fly
from topo_search.simulation.plant import ModelErrors, Plant, in_wakes, nominal
from topo_search.simulation.result import NO_DOWNWASH, FlightResult
from topo_search.simulation.scenarios import Scenario, dead_rotor, imbalance
from verify import audit
from verify.kinematics import platform


@pytest.fixture
def command(tmp_path, monkeypatch, wall_press):
    """The command in an empty folder with a design."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "wall.json").write_text(to_json(wall_press))
    return partial(invoke, "fly")


@pytest.fixture(scope="module")
def flown(wall_press: Design):
    """All flights of a design with reserves."""
    return fly_all(wall_press, Options(), rotor_out=True)


def test_a_design_with_reserves_holds_everything(flown) -> None:
    result = flown.result
    assert (result.verdict, result.outcome) == ("held", "recovered")
    by_name = {one.name: one for one in result.scenarios}
    assert by_name["hover"].drift_m < 0.01
    for side in ("+x", "+y", "-x", "-y"):
        assert by_name[f"return from {side}"].settled_s < 3
    pressed = by_name["load case 0, load at the tip"]
    assert pressed.force_error_share < 0.05
    assert pressed.force_N == pytest.approx(0.2 * 9.81 * (5 * 0.24 + 0.048), rel=0.05)
    wall = by_name["load case 0, wall"]  # no region is solid: its rotors are where a wall would be
    assert (wall.verdict, wall.outcome, wall.counts) == ("not held", "lost", False)
    assert wall.reason.endswith(
        "struck the wall after 0.0 s: the task has no solid region that keeps parts out of it"
    )
    assert by_name["load case 1"].reason == "same as hover, flown above"
    assert "accelerate the platform by [2.94, 0.00, 0.00] m/s^2" in by_name["load case 2"].reason
    assert not any(name.startswith("tilt") for name in by_name)  # the task asks for none
    counting = [one for one in result.scenarios if one.counts]
    assert {one.verdict for one in counting} == {"held", "not flown"}
    assert all((one.saturated_share or 0) <= 0.05 for one in counting)
    assert (result.options["wake_loss_share"], len(result.notes)) == (0.0, 1)  # no wake meets a rotor
    assert result.scenarios[-1].name.endswith("dies")
    assert result.rotors_out == result.rotors == 20


def test_a_rotor_that_dies_is_felt_and_made_good(flown) -> None:
    scenario, track = flown.flown[-1]
    shares, t = np.array(track.shares), np.array(track.time)
    assert shares[t < 1, scenario.dead].mean() > 0.1
    assert np.all(shares[t > 1.2, scenario.dead] == 0)
    assert max(track.tilt) > 0.5
    assert track.tilt[-1] < 0.2


def test_a_death_is_known_after_the_time_of_its_detection(wall_press: Design) -> None:
    scenario = dead_rotor(3, wall_press.task, counts=True)
    shares = {}
    for detection in (0.1, 0.4):
        track, _ = fly(wall_press, replace(scenario, seconds=1.6), Options(detection=detection))
        shares[detection] = np.array(track.shares)[:, 3] > 0
    assert [round(1.0 + np.count_nonzero(shares[d][200:]) * 0.005, 3) for d in shares] == [1.1, 1.4]


def test_the_same_seed_flies_the_same(wall_press: Design) -> None:
    runs = [
        fly_all(
            wall_press, Options(ModelErrors(model=0.02, noise=1.0, seed=seed)), only=("hover",)
        ).result.scenarios[0]
        for seed in (1, 1, 2)
    ]
    assert runs[0] == runs[1] != runs[2]
    assert {run.verdict for run in runs} == {"held"}


@pytest.mark.parametrize("seed", few([1, 2], 1))
def test_errors_of_masses_and_thrusts_are_trimmed_before_a_flight(wall_press: Design, seed: int) -> None:
    """By 5 %, which integrals take seconds to learn."""
    (hover,) = fly_all(wall_press, Options(ModelErrors(model=0.05, seed=seed)), only=("hover",)).result.scenarios
    assert (hover.verdict, hover.drift_m < 5e-3) == ("held", True)


def test_tilts_that_an_answer_did_without_are_flown_and_do_not_count(wall_press: Design) -> None:
    flight = wall_press.task.flight.model_copy(update={"dropped": ("flight.tilt_deg",)})
    fragile = wall_press.model_copy(update={"task": wall_press.task.model_copy(update={"flight": flight})})
    tilts = fly_all(fragile, Options(), only=("tilt about",)).result.scenarios
    assert [(one.outcome, one.counts) for one in tilts] == [("recovered", False)] * 2 + [("saturated", False)] * 2
    assert all(one.tilt_deg < 0.5 for one in tilts)


def test_a_tilt_that_is_required_counts_and_has_the_size_that_is_required(wall_press: Design) -> None:
    flight = wall_press.task.flight.model_copy(update={"tilt_deg": 6.0})
    steep = wall_press.model_copy(update={"task": wall_press.task.model_copy(update={"flight": flight})})
    ((scenario, track),) = fly_all(steep, Options(), only=("tilt about -x",)).flown
    assert scenario.counts
    turned, final = [], []

    def watch(plant, t) -> None:
        turned.append(float(np.degrees(np.arccos(plant.R[2, 2]))))
        final.append(plant.R[1, 2])

    fly(steep, scenario, Options(), watch)
    assert turned[-1] == pytest.approx(6.0, abs=0.5)
    assert final[-1] > 0  # z leans towards +y about -x
    assert track.tilt[-1] < 0.5


def test_a_rotor_loses_in_flight_the_share_that_the_audit_states() -> None:
    """At the thrusts of the worst load case; at a quarter of them twice that share."""
    folded = random_design(Topology.from_key("af0000"), 1)
    wakes = np.array(worst_wakes(folded))
    shares = np.array([[rotor.thrust_loss for rotor in case.rotors] for case in audit(folded).air.cases])
    T = folded.inputs.reshape(shares.shape) * folded.task.module.thrust_coefficient
    lost = 1 - in_wakes(T, wakes) / T
    assert (shares > 0.01).any()
    assert np.all(lost >= shares - 1e-9)
    assert np.min(lost - shares, axis=0) == pytest.approx(0.0, abs=1e-9)
    assert 1 - in_wakes(T / 4, wakes) / (T / 4) == pytest.approx(np.minimum(1.0, 2 * np.sqrt(wakes / T)))


def test_wakes_take_thrust_unless_they_are_switched_off(wall_press: Design) -> None:
    known, wakes = nominal(wall_press), np.linspace(0.0, 1e-3, 20)
    T = np.full(20, 0.5)
    plain, blown = (Plant(wall_press, ModelErrors(wakes=given)) for given in ((), tuple(wakes)))
    for plant in (plain, blown):
        plant.place(known.com, np.array([1.0, 0.0, 0.0, 0.0]))
    lacking = blown.missing_wrench(T) - plain.missing_wrench(T)
    np.testing.assert_allclose(lacking, known.B @ np.sqrt(0.5 * wakes), atol=1e-9)
    blown.step(T, np.zeros(6), np.zeros(6))
    assert blown.data.ctrl == pytest.approx(0.5 - np.sqrt(0.5 * wakes))
    assert describe_losses(known, tuple(wakes)).endswith("less than the rotors can add.")
    assert describe_losses(known, tuple(0.8 * known.largest_thrust)).endswith("more than the rotors can add.")
    off = fly_all(wall_press, Options(wake=False), only=("load case 1",)).result
    assert (off.options["wake_loss_share"], off.notes) == (0.0, (NO_DOWNWASH,))


def test_what_is_no_steady_flight_is_told_by_its_balance(wall_press: Design) -> None:
    W = wall_press.task.force_unit(5)
    tip = Wrench(force=(1.0, 0.0, 0.0), torque=(0.1, 0.0, 0.0))
    steady = LoadCase(units="SI", end_effector=tip, com=Wrench(force=(0.0, 0.0, W)))
    assert imbalance(wall_press, steady) is None
    whole = LoadCase(units="SI", end_effector=Wrench(force=(1.0, 0.0, W)))
    assert "would accelerate the platform by [0.00, 0.00, -9.81] m/s^2" in str(imbalance(wall_press, whole))
    turns = LoadCase(units="SI", com=Wrench(force=(0.0, 0.0, W), torque=(0.1, 0.0, 0.0)))
    assert imbalance(wall_press, turns) == "not a steady flight: nothing reacts the torque at the centre of mass"


def test_a_rod_too_heavy_to_hover_with_is_refused(wall_press: Design) -> None:
    end_effector = wall_press.task.end_effector.model_copy(update={"rod_linear_density": 20.0})
    heavy = wall_press.model_copy(
        update={"task": wall_press.task.model_copy(update={"end_effector": end_effector})}
    )
    with pytest.raises(BadInput, match="unbalanced, with the mass of the rod; nothing was flown"):
        fly_all(heavy, Options())


def test_one_module_hovers_but_cannot_hold_its_place_level() -> None:
    task = {"end_effector": {"mass": 0.0}}
    level = random_design(Topology.from_key("a0"), 1, task).model_copy(
        update={"root_orientation_rad": (0.0, 0.0, 0.0)}
    )
    result = fly_all(level, Options(), only=("return from +x",)).result
    assert (result.outcome, result.weakest_force_N, result.rotors_out) == ("lost", 0.0, 0)


def test_files_and_answer_of_the_command(command, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("topo_search.simulation.files.FRAMES_EVERY", 160)  # drawing takes longer than flying
    words = ("wall.json", "--out", "flight", "--video", "film.gif", "--only", "return from +x", "--seed", "3")
    result = command(*words, "--detection-time", "0.2", "--no-wake")
    assert result.stdout.splitlines()[1].split()[:4] == ["return", "from", "+x", "recovered"]
    assert result.stdout.endswith("in simulation: recovered\n")
    assert result.stderr == "return from +x: recovered\n"
    read = FlightResult.model_validate_json((tmp_path / "flight/flight.json").read_text())
    assert NO_DOWNWASH in read.notes
    assert (read.options["seed"], read.options["detection_time_s"], read.options["wake_loss_share"]) == (3, 0.2, 0)
    assert (read.rotors_out, read.hover_only, read.rotors) == (20, 0, 20)
    assert "survive" not in result.stdout
    rows = list(csv.DictReader(io.StringIO((tmp_path / "flight/flight.csv").read_text())))
    assert {row["scenario"] for row in rows} == {"return from +x"}
    assert [float(row["time_s"]) for row in rows] == pytest.approx(np.arange(250) * 0.02)
    assert float(rows[0]["error_x_m"]) == pytest.approx(0.1, abs=1e-3)
    late = [row for row in rows if float(row["time_s"]) >= 3]
    drift = max(np.linalg.norm([float(row[f"error_{axis}_m"]) for axis in "xyz"]) for row in late)
    assert drift == pytest.approx(read.scenarios[0].drift_m, rel=0.05)
    with Image.open(tmp_path / "flight/flight.png") as plot:
        assert plot.size[0] > 800
    with Image.open(tmp_path / "film.gif") as film:
        assert (film.n_frames, film.size) == (7, (1280, 720))
        pixels = np.asarray(film.convert("L"))
    assert pixels[0].min() > 240  # the sky
    assert pixels[600].max() < 240  # the ground
    assert pixels[300:400, 500:780].min() < 60  # the platform
    assert np.ptp(pixels[664:704, 24:200]) > np.ptp(pixels[664:704, 900:1200])  # the caption


@pytest.mark.parametrize("suffix", [".gif", ".webp"])
def test_a_film_has_all_its_frames(suffix: str) -> None:
    film = files.Film(1.0)
    film.frames = [files._with_caption(np.full((720, 1280, 3), 200, np.uint8), f"{t} s") for t in range(3)]
    with Image.open(io.BytesIO(film.encode(suffix))) as read:
        assert (read.n_frames, read.size) == (3, (1280, 720))


@pytest.mark.parametrize(("film", "status"), [((), 0), (("--video", "film.gif"), 2)], ids=["no film", "film"])
def test_only_a_film_needs_graphics(wall_press, tmp_path, film, status) -> None:
    """MuJoCo cannot be imported with a graphics library that is missing."""
    (tmp_path / "wall.json").write_text(to_json(wall_press))
    done = subprocess.run(
        [sys.executable, "-m", "topo_search", "fly", "wall.json", "--only", "hover", "--no-wake", *film],
        cwd=tmp_path,
        env={**os.environ, "MUJOCO_GL": "none-such"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == status, done.stderr
    assert len(done.stderr.splitlines()) == 1


def test_json_and_status_of_a_flight_that_fails(command, tmp_path, solved_push) -> None:
    (tmp_path / "push.json").write_text(to_json(solved_push))
    result = command("push.json", "--only", "return from +x", "--json", status=1)
    assert json.loads(result.stdout)["verdict"] == "not held"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["none.json"], "none.json: no such file"),
        (["wall.json", "--video", "film.mp4"], "--video: must end in .gif or .webp, but got film.mp4"),
        (["wall.json", "--only", "loop"], "must begin the name of a scenario, one of hover, return from +x,"),
        (["wall.json", "--model-error", "0.9"], "is not in the range 0<=x<=0.5"),
    ],
)
def test_bad_input_is_one_line_and_status_two(command, tmp_path, words, said) -> None:
    assert said in " ".join(command(*words, status=2).stderr.split())
    assert {path.name for path in tmp_path.iterdir()} == {"wall.json"}


def test_without_the_simulator_the_answer_is_how_to_install_it(command, monkeypatch) -> None:
    for name in [name for name in sys.modules if name.startswith("topo_search.simulation.")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "mujoco", None)
    result = command("wall.json", status=2)
    assert result.stderr.endswith('needs mujoco, which is not installed; run: pip install "topo-search[sim]"\n')


def test_every_corner_of_a_set_of_wrenches_is_flown(wall_press: Design) -> None:
    """A cone has eight besides its own wrench, which is hover; one out of reach fails, and says why."""
    task = wall_press.task
    hover = LoadCase(units="SI", com=Wrench(force=(0.0, 0.0, task.force_unit(5))))
    axis = task.load_cases[0].at_end_effector.force
    wide = ForceCone(axis=axis, half_angle_deg=10.0, force=1.0)
    cone = hover.model_copy(update={"name": "lean", "cone": wide})
    pushes = (Wrench(force=(0.0, 0.0, 0.5)), Wrench(force=(0.0, 1000.0, 0.0)))
    hull = hover.model_copy(update={"vertices": pushes})
    falls = LoadCase(units="SI", end_effector=Wrench(force=(1.0, 0.0, 0.0)), vertices=pushes)
    cases = {"load_cases": (cone, hull, falls)}
    asked = wall_press.model_copy(update={"task": task.model_copy(update=cases)})
    some = ("load case 0 (lean), corner 7", "load case 1, corner 1", "load case 2")
    planned = [each.name for each in plan(asked, 0, False) if each.name.startswith("load case")]
    assert planned == [
        *("load case 0 (lean)", *(f"load case 0 (lean), corner {k}" for k in range(8))),
        *("load case 1", "load case 1, corner 0", "load case 1, corner 1", "load case 2"),
    ]
    result = fly_all(asked, Options(wake=False), only=some).result  # its inputs are of other cases
    leaning, out_of_reach, falling = result.scenarios
    assert (leaning.verdict, falling.verdict) == ("held", "not flown")
    assert leaning.force_N == pytest.approx(np.hypot(1.0, np.tan(np.radians(10)) / np.cos(np.pi / 8)), rel=0.05)
    assert out_of_reach.verdict == "not held"
    assert "rotors could not produce" in out_of_reach.reason
    assert falling.reason.startswith("not a steady flight")
    assert falling.reason.endswith("; nor are its 2 corners")


@pytest.mark.parametrize(("contact", "walls"), [("push", 1), ("pull", 0)])
def test_a_case_that_pulls_at_an_object_is_not_flown_against_a_wall(
    wall_press: Design, contact: Literal["push", "pull"], walls: int
) -> None:
    case = wall_press.task.load_cases[0].replace(contact=contact)
    task = wall_press.task.model_copy(update={"exposure": objects([case])})
    planned = plan(wall_press.model_copy(update={"task": task}), 0, False)
    assert [each.counts for each in planned if each.name.endswith(", wall")] == walls * [True]


def test_of_many_corners_those_are_flown_that_can_grow_least(wall_press: Design) -> None:
    task = wall_press.task
    weight = Wrench(force=(0.0, 0.0, task.force_unit(5)))
    pushes = [(0.1 * (1 + k), 0.0, 0.0) for k in range(9)] + [(0.0, 0.1 * (1 + k), 0.0) for k in range(9)]
    hull = LoadCase(units="SI", com=weight, vertices=tuple(Wrench(force=force) for force in pushes))
    asked = wall_press.model_copy(update={"task": task.model_copy(update={"load_cases": (hull, hull)})})
    planned = [each for each in plan(asked, 0, False) if each.name.startswith("load case")]
    flown = [each for each in planned if isinstance(each, Scenario)]
    assert len(flown) == CORNERS
    left = [each for each in planned if each.name.endswith("other corners")]
    assert {each.verdict for each in left} == {"not flown"}
    assert sum(int(each.name.split()[3]) for each in left) == 36 - CORNERS
    assert "12 corners of all load cases with the least load factors" in left[0].reason

    known, at = nominal(asked), platform(asked)

    def can(force: np.ndarray) -> bool:
        wrench = np.array([*force, *np.cross(at.p_e - known.com, force)])
        wrench[2] += known.weight
        return lsq_linear(known.B / known.weight, wrench / known.weight, (0, known.largest_thrust)).cost < 1e-10

    growths = []
    for force in map(np.array, pushes):
        growth = known.hover.load_factor(np.array([*force, *np.cross(at.p_e - known.com, force)]))
        assert (can(0.99 * growth * force), can(1.01 * growth * force)) == (True, False)
        growths += [growth, growth]  # of both load cases
    limit = sorted(growths)[CORNERS - 1]
    for each in flown:
        assert known.hover.load_factor(known.about_com(each.exerted)) <= limit * (1 + 1e-9)


def test_a_death_counts_where_the_task_or_the_command_asks_for_it(wall_press: Design) -> None:
    task = wall_press.task
    asking = task.model_copy(update={"flight": AskedFlight(rotor_out="hover")})
    for asked, rotor_out, counts in ((task, False, False), (task, True, True), (asking, False, True)):
        design = wall_press.model_copy(update={"task": asked})
        *_, dies = plan(design, 7, rotor_out)
        assert (dies.name, dies.counts) == ("rotor 3 of module 1 dies", counts)


def test_who_cannot_hover_can_add_nothing() -> None:
    known = nominal(random_design(Topology.from_key("a0"), 1))
    assert known.hover.load_factor(np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])) == 0.0
    assert known.hover.load_factor(np.zeros(6)) == np.inf
