"""Exports of platforms with types of module: every module has its own mass, parts, connectors and rotors."""

import csv
import io
from typing import Any
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
import trimesh
from typed_cases import DESIGN, ROTORS, typed

from topo_search.export.allocation import allocation, allocator_file, px4_parameters
from topo_search.export.brackets import printed_parts, struts
from topo_search.export.mjcf import mjcf
from topo_search.export.sheet import parts_csv, parts_list, sheet
from topo_search.export.solids import glb, stl
from topo_search.export.urdf import urdf
from topo_search.model import Topology
from verify.flight.joints import inertia
from verify.kinematics import has_rotor, platform, wrench_map

NAMES = [f"module_{i}_rotor_{q}" for i, count in enumerate(ROTORS) for q in range(count)]


def test_the_simulated_platform_has_the_masses_and_wrenches_of_the_audit() -> None:
    model = mujoco.MjModel.from_xml_string(mjcf(DESIGN))
    data, task, at = mujoco.MjData(model), DESIGN.task, platform(DESIGN)
    masses = [model.body(f"module_{i}").mass[0] for i in range(4)]
    assert masses == [module.mass for module in task.modules_of_nodes] == [0.2, 0.3, 0.15, 0.2]
    assert model.body("platform").subtreemass[0] == pytest.approx(task.total_mass(4), rel=1e-9)
    assert [model.actuator(k).name for k in range(model.nu)] == NAMES
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    for i in range(4):
        assert data.body(f"module_{i}").xpos == pytest.approx(at.o[i], abs=1e-9)
    assert data.subtree_com[1] == pytest.approx([0, 0, 0], abs=1e-9)
    u = DESIGN.inputs.ravel()
    assert data.qfrc_actuator == pytest.approx(wrench_map(at, task.modules_of_nodes) @ u, rel=1e-9, abs=1e-9)
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    assert full[3:, 3:] == pytest.approx(inertia(DESIGN, at), rel=1e-6, abs=1e-8)
    ranges = model.actuator_ctrlrange
    largest = np.array([rotor.largest_thrust_N for rotor in allocation(DESIGN).rotors])
    assert ranges[:, 1] == pytest.approx(largest)
    assert ranges[:, 0] == pytest.approx(0.04 * largest)  # [module]'s share, of each rotor's own largest thrust
    names = [text.attrib["data"] for text in ElementTree.fromstring(mjcf(DESIGN)).iter("text")]
    assert names == ["quad", "battery", "tri & tilt", "quad"]


def test_urdf_has_a_link_per_module_of_its_type_and_none_for_absent_rotors() -> None:
    robot, at = ElementTree.fromstring(urdf(DESIGN)), platform(DESIGN)
    links = {link.attrib["name"]: link for link in robot.findall("link")}
    masses = [float(links[f"module_{i}"].find("inertial/mass").attrib["value"]) for i in range(4)]
    assert masses == [0.2, 0.3, 0.15, 0.2]
    assert [name for name in links if "rotor" in name] == NAMES
    colours = [links[f"module_{i}"].find("visual/material").attrib["name"] for i in range(4)]
    assert colours == ["module quad", "module battery", "module tri & tilt", "module quad"]
    total = sum(float(mass.attrib["value"]) for mass in robot.iter("mass"))
    assert total == pytest.approx(DESIGN.task.total_mass(4), rel=1e-9)
    places = {joint.attrib["name"]: joint.find("origin").attrib["xyz"] for joint in robot.findall("joint")}
    hinge = np.array(list(map(float, places["module_0_to_joint_1"].split())))
    assert hinge == pytest.approx(at.joints[0] + at.p_com, abs=1e-9)


def test_the_allocation_has_a_column_for_each_rotor_that_there_is() -> None:
    acts, at = allocation(DESIGN), platform(DESIGN)
    assert [rotor.name for rotor in acts.rotors] == NAMES
    A = wrench_map(at, DESIGN.task.modules_of_nodes)[:, has_rotor(DESIGN.task).ravel()]
    assert np.array(acts.matrix) == pytest.approx(A, rel=1e-12)
    assert acts.mass_kg == pytest.approx(0.2 * 2 + 0.15 + 0.3 + 0.048 + 3 * 0.05)
    assert acts.rotors[5].largest_thrust_N == pytest.approx(2.0)  # of the tricopter's second rotor
    assert len(list(csv.reader(io.StringIO(acts.rotor_csv())))) == 1 + len(NAMES)
    data: dict[str, Any] = {}
    exec(allocator_file(DESIGN, acts), data)
    assert len(data["LARGEST"]) == len(data["LEAST"]) == len(NAMES)
    assert np.divide(data["LEAST"], data["LARGEST"]) == pytest.approx(0.04)


def test_solids_are_those_of_each_type() -> None:
    scene = trimesh.load_scene(io.BytesIO(glb(DESIGN)), file_type="glb")
    nodes = [str(name).rpartition("_")[0] for name in scene.graph.nodes_geometry]
    assert [nodes.count(f"frame of {name}") for name in ("quad", "tri & tilt", "battery")] == [2, 1, 1]
    assert nodes.count("rotors of battery") == nodes.count("airflow of battery") == 0
    assert nodes.count("airflow of quad") == 2
    assert sorted(scene.geometry["frame of battery"].extents) == pytest.approx([0.05, 0.06, 0.12])


def test_equal_types_make_the_files_of_a_platform_without_types() -> None:
    halves = [{"name": name, "count": 1} for name in ("one", "other")]
    one, other = typed(Topology.from_key("a10-ab"), halves), typed(Topology.from_key("a10"), [])
    facets = [sorted(np.frombuffer(stl(design, "all")[84:], "V50").tolist()) for design in (one, other)]
    assert facets[0] == facets[1]
    assert allocation(one) == allocation(other)
    assert px4_parameters(allocation(one)) == px4_parameters(allocation(other))
    parts = [parts_list(design, printed_parts(design)) for design in (one, other)]
    assert parts[0][2:] == parts[1][1:]  # but for the rows of modules
    models = [mujoco.MjModel.from_xml_string(mjcf(design)) for design in (one, other)]
    for field in ("body_mass", "body_inertia", "body_pos", "actuator_gear", "actuator_ctrlrange", "geom_size"):
        assert np.array_equal(*(getattr(model, field) for model in models)), field


def test_a_kit_fits_brackets_to_modules_of_unequal_size() -> None:
    design = typed(bracket={"bolt_circle": 0.023})
    rows = list(csv.DictReader(io.StringIO(parts_csv(parts_list(design, printed_parts(design))))))
    modules = {row["size"]: (int(row["count"]), float(row["mass_kg"])) for row in rows if row["part"] == "module"}
    assert modules == {"quad": (2, 0.2), "tri & tilt": (1, 0.15), "battery": (1, 0.3)}
    set_back = design.task.module.bracket_sizes.set_back
    faces = {(round(kind.inner, 9), round(kind.outer, 9)): kind.number for kind in struts(design)}
    assert faces[0.06, round(0.11 - set_back, 9)] == 1  # the battery's at -x, half its hub from its centre
    assert {outer for _, outer in faces} == {round(0.11 - set_back, 9), round(0.15 - set_back, 9)}
    page = sheet(design, printed_parts(design), ())
    for said in ("Type battery: no rotors, 300 g. It is at the modules 1.", "of module 1, battery, to port"):
        assert said in page
    assert f"{1000 * (0.11 - set_back):.2f} mm (battery)" in page
