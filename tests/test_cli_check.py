"""`topo-search check`: a task in words, its warnings, and its picture."""

import json
import math
import re
import sys
import xml.etree.ElementTree as ElementTree
from functools import cache, partial
from pathlib import Path

import matplotlib.image
import numpy as np
import pytest
from commands import invoke, refused
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, Polygon
from wording import says

import nlp
from topo_search.export.task_picture import VIEWS, task_figure
from topo_search.model.flying import scaled_defaults
from topo_search.model.task_file import read_task
from topo_search.topologies import candidates

check = partial(invoke, "check")
SEARCH = "search, and a bound on control effort if every wrench is met exactly"
TWO = ("--modules", "2")
"""Bounds of load cases with many corners take long for five."""


@cache
def groups(*words: str) -> dict[str, dict[str, str]]:
    """What is printed: below each title values by name, wrapped lines joined."""
    result = check(*words)
    found: dict[str, dict[str, str]] = {}
    title = ""
    for line in re.sub(r"\n {41}", " ", result.stdout).splitlines()[1:]:
        if line.startswith("  "):
            name, value = re.fullmatch(r"  (.{38}) (.*)", line).groups()  # type: ignore[union-attr]
            found[title][name.rstrip()] = value
        elif line:
            title = line
            found.setdefault(title, {})
    return found


def test_a_task_in_words_with_its_units_resolved() -> None:
    said = groups("push-two-paths")
    assert said["platform"]["weight m_t g"] == "12.24 N, at g = 9.81 m/s²"
    assert said["platform"]["unit of torque l_arm m_t g"] == "1.224 N m"
    cases = said["load cases, each the total wrench of the rotors"]
    assert cases["load case 0"] == "force at the end-effector [6.12, 0, 6.12] N = [0.5, 0, 0.5] m_t g; weight 1"
    assert cases["load case 2"] == "force at the centre of mass [0, 0, 12.2] N = [0, 0, 1] m_t g; weight 1"
    (paths,) = said["must stay out of the airflow"].values()
    assert paths == "capsules of radius 15 cm along 2 paths from the end-effector to [1, 0, 0], [1, 1, −1] m"
    (inside,) = groups("wall-push")["airflow must stay where"].values()
    assert says(inside, "[1, 0, 0] · x ≤ 0 mm", "solid: rotors, arms and rod too")
    assert said[SEARCH]["trees"].startswith("trees that differ only by turning modules by 180 deg are merged")
    assert said[SEARCH]["5 modules"].startswith("49 candidates; J at least ")
    assert said["module"]["figure of merit"] == "0.165, with rotors of 5 cm radius"
    assert said["module"]["thrust coefficient C_T"].startswith("0.127, of propellers")
    assert said["module"]["rotor tip speed"] == "61.7 m/s at hover, 97.5 m/s at full thrust"
    assert list(said["warnings"]) == ["module.torque_coefficient", "load_cases[0]", "load_cases[1]"]


def test_warnings_come_first_and_no_air_of_a_module_in_millimetres() -> None:
    told = groups("push-local", "--set", "module.arm_length=100", "--set", "module.connector_distance=150")
    assert next(iter(told)) == "warnings"
    assert {"module.arm_length", "module.connector_distance"} <= set(told["warnings"])
    assert not [title for title in told if title.startswith("air of")]


def test_load_cases_are_told_by_name_and_those_without_cost_say_so() -> None:
    said = groups("push", "--set", "load_cases[0].name=to the side", "--set", "load_cases[2].weight=0.0")
    cases = said["load cases, each the total wrench of the rotors"]
    assert list(cases) == ["load case 0 (to the side)", "load case 1", "load case 2"]
    assert cases["load case 2"].endswith("; weight 0: required, but adds no control effort")
    assert "load_cases" not in said["warnings"]


def test_sets_of_wrenches_are_told_with_their_corners() -> None:
    cone = "load_cases[0].cone={axis=[1, 0, 0], half_angle_deg=20, force=0.5}"
    said = groups("push", *TWO, "--set", cone, "--set", "load_cases[1].vertices=[{force=[0, 0.5, 0.4]}]")
    first, second, _ = said["load cases, each the total wrench of the rotors"].values()
    within = "any force up to 2.59 N within 20° of [1, 0, 0]: 9 corners, which suffice"
    assert f"at the end-effector {within}; weight 1" in first
    assert "all wrenches between its own and force [0, 2.59, 2.07] N, torque [0, 0, 0] N m: 1 corner" in second


def test_reserves_are_told_where_they_are_asked_for() -> None:
    title = "required beyond the load cases"
    assert title not in groups("push")
    level = ("--set", "flight.directions=horizontal")
    asked = ("--set", "flight.force_reserve=0.1", "--set", "flight.torque_reserve=0.05")
    told = groups("push", *TWO, *asked, *level)[title]
    assert told == {
        "around": "hover",
        "force reserve": "any horizontal force of 0.518 N = 0.1 m_t g at the end-effector or at the centre of mass",
        "torque reserve": "any of 0.0259 N m",
    }
    told = groups("push", *TWO, "--set", "flight.rotor_out=hover", "--set", "flight.joint_moment=2.0")[title]
    assert told == {
        "with any one rotor dead": "hover, any torque of 0.00518 N m to spare",
        "moment in a joint": "at most 2 N m in every load case",
    }


def test_goals_are_told_where_there_are_any() -> None:
    title = "goals besides control effort"
    assert title not in groups("push")
    told = groups("push", "--set", "goals.stand_off=[0.2, 0.35]", "--set", "goals.peak_input=[1.0, 0.9, 0.8]")[
        title
    ]
    assert told == {
        "stand-off of the end-effector": "20 cm, 35 cm",
        "largest rotor input": "1 u_max, 0.9 u_max, 0.8 u_max",
        "searches": "6 levels",
    }


def test_tolerances_are_told_where_there_are_any() -> None:
    required, measured = "tolerances that clearances must survive", "tolerances that are measured, not required"
    assert not {required, measured} & set(groups("push"))
    settings = ("--set", "tolerances.hinge_angle_deg=0.5", "--set", "tolerances.position=0.002")
    for title, other, more in (
        (required, measured, ()),
        (measured, required, ("--set", "flight.tolerances=false")),
    ):
        told = groups("push", *settings, *more)
        assert list(told[title].values()) == ["within 0.5°", "within 2 mm", "up to 0 mm"]
        assert other not in told
        assert "required beyond the load cases" not in told


def test_of_a_range_of_sizes_each_has_its_weight_and_its_candidates() -> None:
    said = groups("push", "--modules", "2-3")
    assert said["platform"]["size"] == "2, 3 modules"
    assert said["platform"]["weight m_t g"] == "5.18, 7.534 N, at g = 9.81 m/s²"
    assert "load cases of 2 modules, each the total wrench of the rotors" in said
    assert list(said[SEARCH]) == ["trees", "2 modules", "3 modules"]


def test_a_proof_stands_in_place_of_the_bound() -> None:
    said = groups("push", "--set", "module.max_thrust_to_weight=0.9")
    assert said[SEARCH]["5 modules"].startswith("28 candidates; impossible: ")
    assert "gravity" in groups("push", "--set", "gravity=1.62")["warnings"]


def test_nothing_is_said_where_nothing_is_odd() -> None:
    drag = "module.torque_coefficient=3.1e-9"
    assert "warnings" not in groups("ten-wrenches", "--modules", "2", "--set", drag)


def test_json_holds_the_resolved_task_its_sizes_and_the_warnings() -> None:
    told = json.loads(check("push", "--modules", "2-3", "--json").stdout)
    task = read_task("push", ("modules=[2, 3]",))
    assert told["task"] == task.resolve(2).model_dump(mode="json")
    for size in told["sizes"]:
        resolved = task.resolve(size["modules"])
        assert size["candidates"] == len(list(candidates(size["modules"], symmetry="task", task=resolved)))
        assert size["lower_bound"] == nlp.lower_bound(resolved)
        proof = nlp.prove_impossible(resolved)
        assert size["impossible"] == (proof and proof.message)
    odd = ["module.torque_coefficient", "load_cases[0]", "load_cases[1]"]
    assert [one["path"] for one in told["warnings"]] == odd


NO_TOLERANCES = "must be false if all of [tolerances] (hinge_angle_deg, position, envelope) are 0"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["none.toml"], "none.toml: no such file, nor a shipped example"),
        (["push", "--set", "module.mass=-1"], "module.mass: must be greater than 0, but got -1"),
        (["push", "--set", "flight.tolerances=true"], f"flight.tolerances: {NO_TOLERANCES}, but got true"),
        (["push", "--picture", "a.jpg"], "--picture: must end in .png, .svg or .pdf, but got a.jpg"),
        (["push", "--picture", "push.toml/a.png"], "--picture: must be writable"),
    ],
)
def test_bad_input_is_status_two(tmp_path, monkeypatch, words, said):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "push.toml").write_text("")
    assert said in refused("check", *words)
    assert [path.name for path in tmp_path.iterdir()] == ["push.toml"]


def test_the_picture_is_written(tmp_path: Path) -> None:
    for name in ("a.png", "a.svg"):
        result = check("push-two-paths", "--picture", str(tmp_path / name))
        assert result.stdout.endswith(f"the picture is in {tmp_path / name}\n")
    assert matplotlib.image.imread(tmp_path / "a.png").shape == (906, 2148, 4)
    assert ElementTree.parse(tmp_path / "a.svg").getroot().tag.endswith("svg")


def test_without_matplotlib_the_answer_is_how_to_install_it(tmp_path, monkeypatch):
    for module in ("picture", "task_picture"):
        monkeypatch.delitem(sys.modules, f"topo_search.export.{module}", raising=False)
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    result = check("push", "--picture", str(tmp_path / "a.png"), status=2)
    assert 'needs matplotlib, which is not installed; run: pip install "topo-search[viz]"' in result.stderr


def regions(figure: Figure) -> list[list[np.ndarray]]:
    """The outlines of all regions, view by view; the last polygon of a view is the module's airflow."""
    return [[p.get_xy() for p in axes.patches if isinstance(p, Polygon)][:-1] for axes in figure.axes]


def test_regions_are_drawn_where_the_task_has_them() -> None:
    views = regions(task_figure(read_task("push-two-paths").resolve(5)))
    ends = np.array([[1.0, 0.0, 0.0], [1.0, 1.0, -1.0]])
    for (right, up, _), outlines in zip(VIEWS, views, strict=True):
        for end, outline in zip(ends[:, [right, up]], outlines, strict=True):
            far = np.maximum(0, end) + 0.15
            np.testing.assert_allclose(outline.max(axis=0), far, atol=1e-3)
            np.testing.assert_allclose(outline.min(axis=0), np.minimum(0, end) - 0.15, atol=1e-3)


@pytest.mark.parametrize("seed", range(5))
def test_a_cone_on_the_paper_is_the_shadow_of_the_cone(seed: int) -> None:
    """Compared with the shadow of many rays on the cone's surface, wherever the view is not into the cone."""
    rng = np.random.default_rng(seed)
    d, half_angle = rng.normal(size=3), rng.uniform(5, 80)
    settings = (f"exposure.0.axis={d.tolist()}", f"exposure.0.half_angle_deg={half_angle}")
    figure = task_figure(read_task("push-exterior-60", settings).resolve(5))
    d /= np.linalg.norm(d)
    s = np.linalg.svd(d[None])[2][1:]  # two unit vectors across d
    turn = np.linspace(0, 2 * math.pi, 20_000)
    theta = math.radians(half_angle)
    rays = math.cos(theta) * d + math.sin(theta) * (np.outer(np.cos(turn), s[0]) + np.outer(np.sin(turn), s[1]))
    for (right, up, _), (outline,) in zip(VIEWS, regions(figure), strict=True):
        middle = math.atan2(d[up], d[right])
        off = (np.arctan2(rays[:, up], rays[:, right]) - middle + math.pi) % (2 * math.pi) - math.pi
        drawn = (np.arctan2(outline[1:-1, 1], outline[1:-1, 0]) - middle + math.pi) % (2 * math.pi) - math.pi
        if abs(d[3 - right - up]) < math.cos(theta):
            assert np.abs(drawn).max() == pytest.approx(np.abs(off).max(), abs=1e-3)
        else:
            assert np.abs(drawn).max() > 3.0


def test_forces_point_where_they_push() -> None:
    front = task_figure(read_task("push").resolve(5)).axes[0]
    labels = {text.get_text(): np.array(text.get_position()) for text in front.texts}
    assert set(labels) == {"0", "1"}  # the third case acts at the centre of mass
    np.testing.assert_allclose(
        labels["0"] / np.linalg.norm(labels["0"]), np.array([1, 1]) / math.sqrt(2), atol=1e-12
    )
    assert abs(labels["1"][0]) < 1e-12 < labels["1"][1]


def test_torques_are_dashed_arrows_through_a_ring() -> None:
    task = read_task("ten-wrenches").resolve(5)
    figure = task_figure(task)
    for (right, up, _), axes in zip(VIEWS, figure.axes, strict=True):
        dashed = [p for p in axes.patches if isinstance(p, FancyArrowPatch) and p.get_linestyle() == "dashed"]
        assert 0 < len(dashed) <= 9
        rings = [np.column_stack(line.get_data()) for line in axes.lines if len(line.get_xdata()) == 49]
        assert len(rings) == 9
        for ring, case in zip(rings, task.load_cases, strict=False):
            torque = np.array(case.at_end_effector.torque)[[right, up]]
            middle = ring[:-1].mean(axis=0)
            assert middle @ torque == pytest.approx(np.linalg.norm(middle) * np.linalg.norm(torque))
    assert sum("N m" in text.get_text() for text in figure.legends[0].get_texts()) == 9


def test_defaults_that_a_module_cannot_hold_are_told_before_the_search(tmp_path: Path) -> None:
    """With what is not excluded: that share of them, and no more, has no proof against it."""
    path = tmp_path / "heavy.toml"
    case = '[[load_cases]]\nname = "hover"\ncarries_weight = true\n'
    path.write_text(f'name = "heavy"\nmodules = 3\n{case}[module]\nmax_thrust = 1.0\n')
    (told,) = json.loads(check(str(path), "--json").stdout)["sizes"]
    assert told["impossible"] is not None
    task = read_task(path)
    shares = (told["defaults_share"], told["defaults_share"] + 0.05)
    proofs = [nlp.prove_impossible(scaled_defaults(task, share).resolve(3)) for share in shares]
    assert [proof is None for proof in proofs] == [True, False]
    (stronger,) = json.loads(check(str(path), "--json", "--set", "module.max_thrust=3.2").stdout)["sizes"]
    assert stronger["impossible"] is stronger["defaults_share"] is None
