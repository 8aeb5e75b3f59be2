"""Runs and designs whose pages are looked at: of the toy problem, so that no solver is needed."""

import re
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
from nlp_cases import random_tree
from toy_problem import toy_run

from topo_search.model import CaseFlight, Design, Flight, JointLoad, RotorsOut, Topology
from topo_search.model.files import to_json
from topo_search.model.task_file import read_task
from topo_search.report.page import render
from topo_search.report.run_page import run_page
from topo_search.simulation.result import NO_DOWNWASH, FlightResult, ScenarioResult, digest_of
from topo_search.study import RunFolder

VOID = {"meta", "input", "link", "br", "img"}


class Reader(HTMLParser):
    """Reads a page: its words, its scripts by their id, its tables; fails on elements that are not closed."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.words: list[str] = []
        self.data: dict[str, str] = {}
        self.links: list[str] = []
        self.ids: list[str] = []
        self._id = ""
        self.feed(text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        self.links += [given[name] for name in ("src", "href") if name in given]
        self._id = given.get("id", "")
        if self._id:
            self.ids.append(self._id)
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        if self.open and self.open[-1] == "script":
            self.data[self._id] = data
        elif self.open and self.open[-1] != "style":
            self.words.append(data)

    @property
    def text(self) -> str:
        return re.sub(r"\s+", " ", " ".join(self.words))


def grown(n: int) -> Topology:
    """Return an aligned tree with modules added at random free ports."""
    return random_tree(n, np.random.default_rng(n), aligned=True)


def design(topology: Topology, name: str = "push", *settings: str, **given: Any) -> Design:
    n = topology.n
    task = read_task(name, (f"modules={n}", *settings)).resolve(n)
    rng = np.random.default_rng(n)
    u_max = task.module.max_input(task.gravity)
    numbers: dict[str, Any] = {
        "root_orientation_rad": rng.uniform(-0.5, 0.5, 3).tolist(),
        "hinge_angles_rad": rng.uniform(-1, 1, n - 1).tolist(),
        "end_effector_m": [0.6, 0.2, 0.4],
        "rotor_speeds_squared": rng.uniform(0, u_max, (len(task.load_cases), 4 * n)).tolist(),
        "objective": 1.2345e13,
        "lower_bound": 1.1194446e13,
        "gap": 0.0932,
    }
    return Design.model_validate({"task": task, "topology": topology, **numbers, **given})


def toy_page(path: Path, **options: Any) -> str:
    """Run the toy problem and return its page."""
    toy_run(path, **options)
    with RunFolder.load(path) as folder:
        return render(run_page(folder))


COURSE_HEAD = "scenario,time_s,error_x_m,error_y_m,error_z_m,tilt_deg,largest_input"


def flown(made: Design, folder: Path, name: str = "load case 0, wall") -> Path:
    """Write what `fly` writes: one flight that failed, one case that was not flown."""
    seen = {"seconds": 8.0, "drift_m": 0.0123, "tilt_deg": 3.25, "saturated_share": 0.06, "missed_share": 0.5}
    scenarios = (
        ScenarioResult(
            name=name, verdict="not held", outcome="saturated", reason="drifted", largest_input=1.0, **seen
        ),
        ScenarioResult(name="load case 1", verdict="not flown", reason="not a steady flight"),
    )
    result = FlightResult(
        design=digest_of(made),
        verdict="not held",
        outcome="saturated",
        scenarios=scenarios,
        weakest_force_N=0.5,
        weakest_force_share=0.02,
        weakest_direction=(0.0, -1.0, 0.0),
        rotors_out=3,
        rotors=4,
        mass_kg=0.25,
        rod_mass_kg=0.001,
        options={"seed": 7, "noise": 1.0, "model_error": 0.02, "motor_lag_s": 0.05},
        versions={},
        notes=(NO_DOWNWASH,),
    )
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "flight.json").write_text(to_json(result))
    rows = [f'"{name}",{0.02 * k},0.03,0.04,0.0,{k},0.5' for k in range(50)]
    (folder / "flight.csv").write_text("\n".join([COURSE_HEAD, *rows, ""]))
    return folder


HOVER = CaseFlight(
    name="hover",
    possible=True,
    horizontal_reserve_N=0.1199,
    horizontal_weakest=(0.0, -1.0, 0.0),
    torque_reserve_Nm=0.25,
    torque_weakest=(0.6, 0.0, 0.8),
    load_factor=1.5,
)


def joint(case: str, force: float, moment: float) -> JointLoad:
    """Return the load of the joint of modules 0 and 1, across its hinge."""
    load = {"force_N": force, "moment_Nm": moment, "about_hinge_Nm": 0.0, "across_hinge_Nm": moment}
    return JointLoad(case=case, module=0, port=0, child=1, **load)


def flight(**fields: object) -> Flight:
    """Return a made-up flight capability."""
    given = {
        "cases": (HOVER, CaseFlight(name="load case 0", possible=True, load_factor=1.02459)),
        "rotors_out_hover": RotorsOut(survive=7, of=8, lost=((1, 3),)),
        "rotors_out_all": RotorsOut(survive=6, of=8, lost=((1, 3),), undecided=((0, 0),)),
        "joints": (joint("load case 0", 3.21, 1.2301),),
        "hinge_tolerance_deg": 0.1,
        "hover_input": 0.5,
        "hover_power_ratio": 1.25,
        "rod_length_m": None,
        "rod_mass_share": None,
        "span_m": 0.75,
    }
    return Flight.model_validate({**given, **fields})
