"""Brackets read back from their STL files, as a printer gets them: put together they are the platform."""

import csv
import io
import math
import re
from pathlib import Path
from xml.etree import ElementTree

import networkx as nx
import numpy as np
import pytest
import trimesh
from export_cases import random_design, rod_ends, with_rod
from numpy.typing import NDArray

import verify
from topo_search.export.allocation import allocation
from topo_search.export.brackets import (
    PrintedPart,
    bracket,
    bracket_file,
    bracket_turns,
    brackets,
    mount,
    printed_parts,
    strut,
    struts,
)
from topo_search.export.sheet import mass_note, parts_csv, parts_list, sheet, strength_note
from topo_search.export.strength import ACROSS, ALONG, factor, strengths
from topo_search.model import BadInput, Design, Topology
from topo_search.model.arrays import PORT_DIRECTIONS
from topo_search.model.bracket import Bracket
from topo_search.model.files import read_json
from topo_search.model.joint_mass import PLASTIC, bolt_of, joint_mass, strut_width
from topo_search.topologies import sample
from verify.kinematics import platform

Array = NDArray[np.float64]
TREES = [
    Topology.from_key("a10"),
    *(tree for n in (5, 12) for tree in sample(n, 2, n)),
    *sample(6, 2, 3, connectors="any"),
]

DESIGN = read_json(Design, Path(__file__).parent / "designs" / "wall-push.json")


def read(part: PrintedPart) -> trimesh.Trimesh:
    """A solid as its file holds it, in metres."""
    mesh = trimesh.load_mesh(io.BytesIO(part.stl()), file_type="stl")
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume > 0
    assert mesh.body_count == 1
    return mesh.apply_scale(1e-3)


def outlines(mesh: trimesh.Trimesh, normal: Array, offset: float) -> list[Array]:
    """The closed outlines of what a solid has in a plane, each by its corners."""
    flat = (np.abs(mesh.triangles @ normal - offset) < 1e-7).all(axis=1)
    edges = np.sort(mesh.faces[flat][:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    unique, count = np.unique(edges, axis=0, return_counts=True)
    graph = nx.Graph(unique[count == 1].tolist())
    return [mesh.vertices[sorted(corners)] for corners in nx.connected_components(graph)]


def mating_face(mesh: trimesh.Trimesh, marks: int, bolt: float) -> tuple[Array, Array, Array]:
    """Centre, outward normal and upward direction of the outermost face with four bolt holes and some marks."""
    found = []
    for facet, normal in zip(mesh.facets, mesh.facets_normal, strict=True):
        if len(facet) < 4 * (4 + marks):  # too few triangles for so many round holes
            continue
        offset = float(normal @ mesh.triangles_center[facet[0]])
        holes = sorted(outlines(mesh, normal, offset), key=lambda loop: np.ptp(loop, axis=0).max())[:-1]
        if len(holes) == 4 + marks:
            centres = np.array([hole.mean(axis=0) for hole in holes])
            np.testing.assert_allclose(np.linalg.norm(holes[-1] - centres[-1], axis=1), bolt / 2, atol=1e-6)
            middle = centres[marks:].mean(axis=0)
            up = centres[:marks].mean(axis=0) - middle
            found.append((float(normal @ middle), middle, normal, up / np.linalg.norm(up)))
    return max(found, key=lambda face: face[0])[1:]


def module_behind(face: tuple[Array, Array, Array], port: int, distance: float) -> Array:
    """Pose of the module that is bolted to a face by a port, (4, 4)."""
    centre, normal, up = face
    towards = -normal  # from the module's centre to its port
    axes = np.stack([towards, np.cross(up, towards), up], axis=1)
    e = PORT_DIRECTIONS[port]
    own = np.stack([e, np.cross([0, 0, 1], e), [0, 0, 1]], axis=1)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = axes @ own.T, centre + distance * normal
    return pose


@pytest.mark.parametrize("tree", TREES, ids=lambda tree: tree.key)
def test_brackets_put_together_are_the_platform(tree: Topology) -> None:
    drawn = random_design(tree, 11)
    angles = (math.radians(round(math.degrees(alpha), 3)) for alpha in drawn.hinge_angles_rad)  # as in names
    design = drawn.model_copy(update={"hinge_angles_rad": tuple(angles)})
    at, module = platform(design), design.task.module
    distance, bolt = module.connector_distance - module.bracket_sizes.set_back, module.bracket_sizes.bolt_diameter
    root = np.eye(4)
    root[:3, :3] = at.poses.R[0]
    poses = [root]
    meshes = {part.file: read(part) for part in brackets(design)}
    for (h, _, a, b), phi in zip(tree.edges(), bracket_turns(design), strict=True):
        faces = (mating_face(meshes[bracket_file(abs(phi))], marks, bolt) for marks in (1, 2))
        marks_up = -1 if phi < 0 else 1  # upside down, mark holes are towards the modules' lower sides
        parent, child = (
            module_behind((centre, normal, marks_up * up), port, distance)
            for (centre, normal, up), port in zip(faces, (a, b), strict=True)
        )
        poses.append(poses[h] @ np.linalg.inv(parent) @ child)
    for i, pose in enumerate(poses):
        np.testing.assert_allclose(pose[:3, 3], at.poses.p[i], atol=1e-4)
        np.testing.assert_allclose(pose[:3, :3], at.poses.R[i], atol=1e-4)


@pytest.mark.parametrize("degrees", [-90.0, -60.0, -1e-3, 0.0, 1e-3, 33.0, 90.0])
@pytest.mark.parametrize("sizes", [Bracket(), Bracket(bolt_circle=0.05, bolt_diameter=0.006, thickness=0.001)])
def test_any_fold_is_a_closed_solid_that_keeps_off_both_modules(degrees: float, sizes: Bracket) -> None:
    mesh = read(PrintedPart("bracket", "", bracket(sizes, math.radians(degrees))))
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    for normal in ([-1.0, 0.0, 0.0], [c, 0.0, -s]):
        assert (mesh.vertices @ normal).max() == pytest.approx(sizes.set_back, abs=1e-7)
    flanges = 2 * (2 * sizes.half_width) ** 2 * sizes.thickness
    assert 0.8 * flanges < mesh.volume < 8 * flanges


def test_there_is_a_file_for_each_kind_of_bracket_and_it_is_counted() -> None:
    angles = tuple(map(math.radians, (84.5, -12.3456, -0.0, 12.3462)))
    design = random_design(Topology.from_key("a70010"), 3).model_copy(update={"hinge_angles_rad": angles})
    assert [(part.file, part.count) for part in brackets(design)] == [
        ("bracket_0.000deg.stl", 1),
        ("bracket_12.346deg.stl", 2),
        ("bracket_84.500deg.stl", 1),
    ]
    page = sheet(design, printed_parts(design), ())
    steps = re.findall("with (bracket_[0-9.]+deg.stl), mark holes (up|down)", page)
    assert steps == [
        ("bracket_84.500deg.stl", "up"),
        ("bracket_12.346deg.stl", "up"),
        ("bracket_0.000deg.stl", "up"),
        ("bracket_12.346deg.stl", "down"),
    ]
    rows = [row for row in parts_list(design, printed_parts(design)) if row[0] == "bracket"]
    assert [row[1] for row in rows] == [1, 2, 1]
    bolts = next(row[1] for row in parts_list(design, printed_parts(design)) if row[0] == "bolt with nut")
    flanges = 8 + sum(kind.number for kind in struts(design)) + len([*mount(design)])
    assert bolts == 4 * flanges


@pytest.mark.parametrize("tree", TREES, ids=lambda tree: tree.key)
def test_the_bore_of_the_mount_is_where_the_rod_is(tree: Topology) -> None:
    design = with_rod(random_design(tree, 4))
    module, (i, port) = design.task.module, tree.free_connectors[-1]
    sideways = np.random.default_rng(tree.n).uniform(-1, 1, 3)
    away = platform(design).poses.R[i] @ (PORT_DIRECTIONS[port] + 0.6 * sideways)  # not back through its own flange
    tip = tuple((rod_ends(design)[0] + 0.4 * away).tolist())
    design = design.model_copy(update={"end_effector_m": tip})
    (part,) = mount(design)
    mesh = read(part)
    bolted = module_behind(
        mating_face(mesh, 1, module.bracket_sizes.bolt_diameter),
        design.mount.port,
        module.connector_distance - module.bracket_sizes.set_back,
    )
    v = platform(design).poses.R[i].T @ away / np.linalg.norm(away)
    radius = design.task.end_effector.rod_radius
    inside = (mesh.vertices - bolted[:3, 3]) @ bolted[:3, :3]
    c = module.connector_distance * PORT_DIRECTIONS[design.mount.port]
    along = (inside - c) @ v
    off = np.linalg.norm(inside - c - along[:, None] * v, axis=1)
    radius += 1e-4  # a sliding fit
    bore = along[np.abs(off - radius) < 2e-6]
    assert len(bore) >= 100
    assert bore.min() == pytest.approx(0, abs=1e-5)
    assert bore.max() == pytest.approx(0.03, abs=1e-5)
    assert not np.any((off < radius - 1e-5) & (along > 1e-5))  # nothing is in the rod's way
    # a slot at the end of the socket, and a bolt across it, upwards or outwards of the rod
    up = np.array([0.0, 0.0, 1.0]) - v[2] * v
    side = np.cross(v, up / np.linalg.norm(up)) if np.linalg.norm(up) > 0.3 else np.cross(v, PORT_DIRECTIONS[port])
    side /= np.linalg.norm(side)
    across, hole = (inside - c) @ side, module.bracket_sizes.bolt_diameter
    ear = hole + 2 * module.bracket_sizes.wall
    outwards = np.cross(side, v)
    axis = c + (0.03 - ear / 2) * v + (0.008 + ear / 2) * outwards
    round_it = np.linalg.norm(inside - axis - ((inside - axis) @ side)[:, None] * side, axis=1)
    rim = across[np.abs(round_it - hole / 2) < 2e-6]
    np.testing.assert_allclose(sorted({round(float(x), 5) for x in rim}), [-0.0035, -0.0005, 0.0005, 0.0035])


def test_brackets_as_large_as_modules_are_refused() -> None:
    design = random_design(Topology.from_key("a10"), 1, {"module": {"bracket": {"bolt_circle": 0.28}}})
    with pytest.raises(BadInput, match=r"module.bracket: must be smaller: .* got 0.1516 for a connector_distance"):
        brackets(design)
    with pytest.raises(ValueError, match=r"bolt_circle > 2 sqrt\(2\) bolt_diameter"):
        Bracket(bolt_circle=0.005)


def keeps_off_rotors(mesh: trimesh.Trimesh, design: Design) -> bool:
    module = design.task.module
    rotors = (module.arm_length / math.sqrt(2) * np.array([1, y]) for y in (1, -1))
    off = [np.linalg.norm(mesh.vertices[:, :2] - rotor, axis=1).min() for rotor in rotors]
    return min(off) > module.body.rotor_radius + 0.0019


def test_short_struts_are_printed_from_the_hub_to_every_bracket_and_keep_off_rotors() -> None:
    fields = {"module": {"body": {"hub": (0.1, 0.1, 0.04)}}}
    design = with_rod(random_design(Topology.from_key("a300"), 3, fields))
    module = design.task.module
    (part,) = [part for part in printed_parts(design) if part.name == "strut"]
    assert (part.file, part.count) == ("strut_76.4mm.stl", 2 * 2 + 1)
    mesh = read(part)
    (centre, normal, up) = mating_face(mesh, 1, module.bracket_sizes.bolt_diameter)
    distance = module.connector_distance - module.bracket_sizes.set_back
    np.testing.assert_allclose(centre, [distance, 0, 0], atol=1e-6)
    np.testing.assert_allclose([normal, up], [[1, 0, 0], [0, 0, 1]], atol=1e-6)
    assert mesh.bounds[0][0] == pytest.approx(module.body.hub[0] / 2, abs=1e-7)
    assert keeps_off_rotors(mesh, design)
    wide = design.task.module.model_copy(update={"body": module.body.model_copy(update={"rotor_radius": 0.068})})
    assert struts(design.model_copy(update={"task": design.task.model_copy(update={"module": wide})})) == []


def test_long_struts_are_tubes_between_printed_ends_and_as_long_as_they_were() -> None:
    design = with_rod(random_design(Topology.from_key("a300"), 3))
    module, sizes = design.task.module, design.task.module.bracket_sizes
    (kind,) = struts(design)
    assert (kind.number, kind.tube) == (5, 0.01)
    solids = printed_parts(design)
    (end,) = [part for part in solids if part.name == "tube end"]
    assert (end.file, end.count) == ("tube-end_10mm.stl", 10)
    mesh = read(end)
    centre, normal, up = mating_face(mesh, 1, sizes.bolt_diameter)
    np.testing.assert_allclose([centre, normal, up], [[0, 0, 0], [-1, 0, 0], [0, 0, 1]], atol=1e-6)
    bore = np.linalg.norm(mesh.vertices[:, 1:], axis=1)
    inside = mesh.vertices[np.abs(bore - 0.0051) < 2e-6][:, 0]
    np.testing.assert_allclose([inside.min(), inside.max()], [sizes.thickness, sizes.thickness + 0.01], atol=1e-7)
    # a nut at its bolt is clear of the socket
    assert sizes.bolt_circle / 2 - 0.9 * 0.003 > 0.005 + sizes.wall
    assert keeps_off_rotors(mesh.apply_translation([module.body.hub[0] / 2, 0, 0]), design)
    rows = {row[0]: row for row in parts_list(design, solids)}
    count, size = rows["tube"][1:3]
    long, outside, hole = (float(number) for number in re.findall(r"[\d.]+(?= mm)", size))
    assert count == 5
    assert long + 2000 * sizes.thickness == pytest.approx(1000 * kind.length, abs=0.06)  # between the flanges
    ring = math.pi / 4 * (outside**2 - hole**2) * 1e-6
    assert float(rows["tube"][3]) == pytest.approx(1600 * ring * long / 1000, rel=1e-3)
    face = module.connector_distance - sizes.set_back - module.body.hub[0] / 2
    assert kind.length == pytest.approx(face)
    page = sheet(design, solids, ())
    assert f"a tube of 10 mm, cut to {long} mm" in " ".join(page.split())


@pytest.mark.parametrize(
    "fields",
    [
        {},
        {"mass": 0.035, "arm_length": 0.045, "connector_distance": 0.065, "body": {"rotor_radius": 0.02}},
        {"mass": 0.9, "arm_length": 0.2, "connector_distance": 0.26, "body": {"rotor_radius": 0.1}},
        {"body": {"rotor_radius": 0.066}},  # no room for struts
    ],
)
def test_the_mass_of_a_joint_is_that_of_its_parts_in_a_flat_kit_of_two_modules(fields: dict[str, object]) -> None:
    drawn = random_design(Topology.from_key("a10"), 1, {"module": fields})
    design = drawn.model_copy(update={"hinge_angles_rad": (0.0,)})
    totals = {row[0]: float(row[4]) for row in parts_list(design, printed_parts(design))}
    module = design.task.module
    printed = [strut(module.bracket_sizes, kind.inner, kind.outer, strut_width(module)) for kind in struts(design)]
    assert bool(printed) == (fields.get("body") != {"rotor_radius": 0.066})
    parts = totals["bracket"] + totals["bolt with nut"] + 2 * sum(PLASTIC * mesh.volume * 1e-9 for mesh in printed)
    assert joint_mass(module) == pytest.approx(parts, rel=0.01)
    as_built = sum(totals.get(name, 0.0) for name in ("bracket", "strut", "tube", "tube end", "bolt with nut"))
    assert 0.85 < as_built / parts < 1.001  # tubes are lighter


def test_modules_too_small_for_any_bolt_are_refused_in_words() -> None:
    tiny = {"mass": 0.002, "arm_length": 0.003, "connector_distance": 0.003, "body": {"rotor_radius": 0.002}}
    with pytest.raises(BadInput, match=r"too small for its own brackets, whose M1\.6 bolts are the smallest"):
        printed_parts(random_design(Topology.from_key("a10"), 1, {"module": tiny}))


# ---- Strength of brackets: against loads of the audit, and plates and beams by hand.


def test_loads_of_brackets_are_those_of_the_audit() -> None:
    flight = verify.audit(DESIGN).flight
    assert flight is not None
    joints = flight.joints
    for child, one in enumerate(strengths(DESIGN), start=1):
        loads = [load for load in joints if load.child == child and load.case != "hover"]
        assert one.moment_Nm == pytest.approx(max(load.moment_Nm for load in loads), rel=1e-3)
        assert one.force_N == pytest.approx(max(load.force_N for load in loads), rel=1e-3)
        assert one.factor > 5


def webs(mesh: trimesh.Trimesh, phi: float) -> tuple[float, float, float]:
    """Area and section moduli, about the hinge and across it, midway between the flanges of a bracket."""
    along = np.array([math.cos(phi / 2), 0.0, -math.sin(phi / 2)])
    height = np.cross(along, [0.0, 1.0, 0.0])
    area, about, across, edges = 0.0, 0.0, 0.0, []
    for loop in mesh.section(plane_origin=np.zeros(3), plane_normal=along).discrete:
        (y, y1), (z, z1) = ((x[:-1], x[1:]) for x in (loop[:, 1], loop @ height))
        parts = y * z1 - y1 * z
        parts *= np.sign(parts.sum())
        area += parts.sum() / 2
        about += (parts * (z * z + z * z1 + z1 * z1)).sum() / 12
        across += (parts * (y * y + y * y1 + y1 * y1)).sum() / 12
        edges.append((np.abs(z).max(), np.abs(y).max()))
    z_max, y_max = np.max(edges, axis=0)
    return area, about / z_max, across / y_max


def test_printed_brackets_of_the_wall_platform_carry_the_moments_of_the_audit() -> None:
    """The stress in the solids as they are printed, under the loads of the audit, is what the sheet says it is."""
    flight, sizes = verify.audit(DESIGN).flight, DESIGN.task.module.bracket_sizes
    assert flight is not None
    meshes = {part.file: read(part) for part in brackets(DESIGN)}
    s = sizes.bolt_circle / math.sqrt(8)
    page = sheet(DESIGN, SOLIDS, ())
    for child, (phi, told) in enumerate(zip(bracket_turns(DESIGN), strengths(DESIGN), strict=True), start=1):
        area, about, across = webs(meshes[bracket_file(abs(phi))], math.radians(abs(phi)))
        factors = []
        for load in (load for load in flight.joints if load.child == child):
            M_h, M_c, F = load.about_hinge_Nm, load.across_hinge_Nm, load.force_N
            web = M_h / about + M_c / across + F / area
            bolt = (M_h + M_c) / (4 * s) + F / 4
            arm = sizes.half_width - sizes.wall - s  # from the bolt to the web beside it
            flange = bolt * arm / (sizes.half_width * sizes.thickness**2 / 6)
            factors.append(min(ALONG / web, ACROSS / flange))
        assert min(factors) == pytest.approx(told.factor, rel=2e-3)
        assert min(factors) > 10
        assert f"<td>{told.moment_Nm:.3f}</td><td>{told.factor:.1f}</td>" in page


@pytest.mark.parametrize("phi", [0.0, -0.8, 1.5])
def test_the_strength_of_a_bracket_is_that_of_its_flange_and_webs(phi: float) -> None:
    sizes = Bracket()
    r, t, w, s = sizes.half_width, sizes.thickness, sizes.wall, sizes.bolt_circle / math.sqrt(8)
    pulled = factor(sizes, phi, 100.0, 0.0, 0.0)  # 25 N a bolt
    assert pulled == pytest.approx(ACROSS / (25 * (r - w - s) / (r * t**2 / 6)))
    thick = sizes.model_copy(update={"thickness": 1.0})  # the webs fail first
    h = 2 * r * math.cos(phi / 2) + math.sin(abs(phi) / 2)
    assert factor(thick, phi, 0.0, 1.0, 0.0) == pytest.approx(ALONG / (1.0 / (2 * w * h**2 / 6)))
    assert factor(sizes, phi, 0.0, 0.0, 0.0) == math.inf


def test_weak_brackets_are_warned_of() -> None:
    bracket = {"bracket": Bracket(thickness=0.0008, wall=0.0005)}
    weak = DESIGN.model_copy(update={"task": DESIGN.task.with_fields("module", **bracket)})
    (told,) = strength_note(weak)
    assert "safety factor of" in told
    assert "below 2" in told
    assert not [*strength_note(DESIGN)]


# ---- Assembly sheet and parts list, for someone who has only the kit.

SVG = "{http://www.w3.org/2000/svg}"
SOLIDS = printed_parts(DESIGN)
ROWS = parts_list(DESIGN, SOLIDS)


def test_the_parts_list_has_every_mass_and_the_total_beside_the_models() -> None:
    rows = {row["part"]: row for row in csv.DictReader(io.StringIO(parts_csv(ROWS)))}
    listed = [row for row in ROWS if row[1] != ""]
    total = sum(int(row[1]) * float(row[3]) for row in listed)
    assert float(rows["all parts"]["total_kg"]) == pytest.approx(total, abs=1e-4)
    assert float(rows["model of the search"]["total_kg"]) == 0.768
    assert (rows["tube end"]["count"], rows["tube end"]["file"]) == ("10", "brackets/tube-end_10mm.stl")
    assert (rows["tube"]["count"], rows["tube"]["size"]) == ("5", "78.4 mm long, 10 mm thick, 8 mm inside")
    assert (rows["bolt with nut"]["count"], rows["bolt with nut"]["size"]) == ("40", "M3 x 12")
    assert (rows["clamp bolt with nut"]["count"], rows["clamp bolt with nut"]["size"]) == ("1", "M3 x 12")
    tubes = float(rows["tube"]["total_kg"]) + float(rows["tube end"]["total_kg"])
    struts_and_their_bolts = tubes + 20 * float(rows["bolt with nut"]["mass_kg"])
    assert total - struts_and_their_bolts - 0.768 == pytest.approx(0.1, abs=3e-3)  # 13 % of the model
    assert bolt_of(0.0055, 0.012) == (5.0, 20)
    joined = total - float(rows["module"]["total_kg"]) - float(rows["rod"]["total_kg"]) - 0.048
    (mass,) = re.findall("joint_mass=([0-9.]+)", mass_note(DESIGN.task, ROWS))
    assert float(mass) == pytest.approx(joined / 2, abs=5e-4)


def test_the_sheet_has_a_picture_of_each_step_and_one_of_the_rod() -> None:
    page = ElementTree.fromstring(sheet(DESIGN, SOLIDS, ()).split("\n", 1)[1])
    steps = [svg for svg in page.iter(SVG + "svg") if svg.get("class") == "step"]
    assert [svg.get("aria-label") for svg in steps] == ["step 1: module 1", "step 2: module 2", "step 3: the rod"]
    edges = DESIGN.topology.edges()
    for k, (svg, (_, i, a, b)) in enumerate(zip(steps, edges, strict=False), start=1):
        labels = [text.text for text in svg.iter(SVG + "text")]
        assert labels == [str(a), str(b), *map(str, range(k + 1))]  # ports, then modules on top
        colours = {polygon.get("fill") for polygon in svg.iter(SVG + "polygon")}
        reds = [x for x in colours if int(x[1:3], 16) > 2 * int(x[5:7], 16)]
        assert reds  # what is new
        assert len(reds) < len(colours)  # what was there
        low_x, low_y, width, height = map(float, svg.get("viewBox").split())
        for circle in svg.iter(SVG + "circle"):
            assert low_x <= float(circle.get("cx")) <= low_x + width
            assert low_y <= float(circle.get("cy")) <= low_y + height
        assert i == k
    assert [text.text for text in steps[-1].iter(SVG + "text")][-1] == "E"


def test_the_protractor_reads_the_angle_between_the_sides_that_are_named() -> None:
    page = ElementTree.fromstring(sheet(DESIGN, SOLIDS, ()).split("\n", 1)[1])
    tables = [[[cell.text or "" for cell in row] for row in table.iter("tr")] for table in page.iter("table")]
    _, *rows = next(one for one in tables if one[0][-1] == "protractor [deg]")
    at = platform(DESIGN)
    for row, (h, i, a, _), alpha in zip(rows, DESIGN.topology.edges(), DESIGN.hinge_angles_rad, strict=True):
        reading, side = row[4].removesuffix(" sides").split(", ")
        up = 1 if side == "upper" else -1
        towards = at.R[h] @ PORT_DIRECTIONS[a]  # from the parent's centre to the joint
        connector = at.p[h] + DESIGN.task.module.connector_distance * towards
        away = (at.p[i] - connector) / np.linalg.norm(at.p[i] - connector)
        between = math.degrees(math.acos(-towards @ away))
        assert float(reading) == pytest.approx(between, abs=0.06)
        assert up * (at.R[h][:, 2] @ away) > 0  # on that side the angle is below 180 degrees
        assert float(row[2]) == pytest.approx(math.degrees(alpha), abs=1e-3)


def test_the_sheet_tells_where_modules_rotors_and_the_autopilot_are() -> None:
    page = ElementTree.fromstring(sheet(DESIGN, SOLIDS, ()).split("\n", 1)[1])
    text = " ".join("".join(page.itertext()).split())
    at = platform(DESIGN)
    tables = [[[cell.text or "" for cell in row] for row in table.iter("tr")] for table in page.iter("table")]
    head, *rows = next(one for one in tables if one[0][-1] == "to the tip [mm]")
    assert head[1:] == ["to module 0 [mm]", "to module 1 [mm]", "to module 2 [mm]", "to the tip [mm]"]
    places = np.vstack([at.p, at.end_effector])
    expected = 1000 * np.linalg.norm(at.p[:, None] - places, axis=2)
    np.testing.assert_allclose([[float(cell) for cell in row[1:]] for row in rows], expected, atol=0.051)
    _, *lie = next(one for one in tables if one[0][-1] == "upper side points to")
    for row, place, R in zip(lie, at.p - at.p_com, at.R, strict=True):
        np.testing.assert_allclose([float(x) for x in row[1:4]], 1000 * place, atol=0.051)
        axes = [[float(x) for x in cell[1:-1].split(",")] for cell in row[4:]]
        np.testing.assert_allclose(axes, R.T, atol=1e-3)
    forward, left, up = (float(cell) / 1000 for cell in lie[0][1:4])  # module 0 from the centre of mass
    (hub,) = re.findall(r"EKF2_IMU_POS_X, Y, Z = (\S+), (\S+), (\S+) m\.", text)
    assert [float(x) for x in hub] == pytest.approx([forward, -left, -up], abs=6e-4)
    drawing = next(svg for svg in page.iter(SVG + "svg") if svg.get("aria-label") == "strut of 86.4 mm")
    assert [words.text for words in drawing.iter(SVG + "text")] == ["40.00", "126.40"]
    com, arrow, upper = (
        np.array([float(x) for x in re.search(rf"{words} \[([^]]+)\]", text)[1].split(",")])  # type: ignore[index]
        for words in ("mass is", "arrow along", "side along")
    )
    np.testing.assert_allclose(at.R[0] @ com, 1000 * at.p_com, atol=0.1)
    np.testing.assert_allclose(at.R[0] @ arrow, [1, 0, 0], atol=1e-3)
    np.testing.assert_allclose(at.R[0] @ upper, [0, 0, 1], atol=1e-3)
    _, *motors = next(one for one in tables if one[0][0] == "PX4 motor")
    for j, (row, one) in enumerate(zip(motors, allocation(DESIGN).rotors, strict=True)):
        turns = "CCW" if one.spin == 1 else "CW"
        assert row[:5] == [str(j + 1), str(j), str(one.module), str(one.rotor), turns]
        np.testing.assert_allclose([float(x) for x in row[5:]], 1000 * np.array(one.position_m), atol=0.051)
    views = [svg for svg in page.iter(SVG + "svg") if svg.get("aria-label", "").startswith("from")]
    assert [[t.text for t in svg.iter(SVG + "text")] for svg in views] == [
        ["+", "0", "1", "2", "E"],
        ["+", "0", "1", "2", "E"],
    ]
