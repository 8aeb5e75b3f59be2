"""The GLB and STL exports, read back by trimesh: closed, of the right volume, in the right place."""

import io
import math
from itertools import product
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pytest
import trimesh
from export_cases import BLOCK, OWN_FRAME, WEDGE, drawn_trees, random_design, rod_ends, with_rod
from numpy.typing import NDArray
from verify_cases import fan

from topo_search.export.picture import figure_of
from topo_search.export.solids import frame, glb, join, rotor_discs, stl
from topo_search.export.task_picture import task_figure
from topo_search.model import Design, Module, Topology
from topo_search.model.mesh import Mesh, cone_sphere
from topo_search.report.scene import scene
from verify.kinematics import platform, rotation

Array = NDArray[np.float64]

Z_UP = np.block([[rotation(0, math.pi / 2), np.zeros((3, 1))], [np.zeros((1, 3)), np.ones((1, 1))]])
"""From glTF's axes, y up, to those of the task."""

FRAME = 0.08 * 0.08 * 0.04 + 4 * 0.10 * 0.02 * 0.02
DISCS = 4 * math.pi * 0.05**2 * 0.02


def loaded_glb(design: Design, **given: Any) -> trimesh.Scene:
    return trimesh.load_scene(io.BytesIO(glb(design, **given)), file_type="glb").apply_transform(Z_UP)


def in_place(scene: trimesh.Scene, node: str) -> trimesh.Trimesh:
    """A node's mesh where it is in the scene."""
    pose, geometry = scene.graph[node]
    return scene.geometry[geometry].copy().apply_transform(pose)


def closed(mesh: Mesh) -> trimesh.Trimesh:
    """The same surface, for trimesh to measure, with its vertices as they are."""
    return trimesh.Trimesh(*mesh, process=False)


def cone_sphere_volume(L: float, r_0: float, r_1: float) -> float:
    """Two caps of balls and the frustum between them, where the tangent cone touches."""
    if abs(r_1 - r_0) >= L:
        return 4 / 3 * math.pi * max(r_0, r_1) ** 3
    c = (r_0 - r_1) / L
    s = math.sqrt(1 - c * c)
    caps = r_1**3 * (2 / 3 - c + c**3 / 3) + r_0**3 * (2 / 3 + c - c**3 / 3)
    height, low, high = L + (r_1 - r_0) * c, r_0 * s, r_1 * s
    return math.pi * (caps + height * (low * low + low * high + high * high) / 3)


@pytest.mark.parametrize(
    ("L", "r_0", "r_1"),
    [(1.2, 0.1, 0.2), (1.0, 0.15, 0.15), (0.5, 0.3, 0.1), (1.0, 0.1, 1.1), (0.1, 0.5, 0.1), (0.0, 0.15, 0.15)],
)
def test_round_volumes_are_closed_lie_inside_and_converge(L: float, r_0: float, r_1: float) -> None:
    P_0, a = np.array([0.1, -0.2, 0.3]), np.array([0.36, 0.48, -0.8])
    P_1 = P_0 + L * a
    exact, missing = cone_sphere_volume(L, r_0, r_1), []
    for sides in (24, 48, 96):
        mesh = closed(cone_sphere(P_0, r_0, P_1, r_1, sides=sides))
        assert mesh.is_watertight
        assert mesh.is_winding_consistent
        missing.append(1 - mesh.volume / exact)
        if sides > 24:
            continue
        # every vertex lies on the surface of a ball, and in none of the others
        eta = np.linspace(0, 1, 2001)[:, None, None]
        depth = r_0 + eta[..., 0] * (r_1 - r_0) - np.linalg.norm(mesh.vertices - P_0 - eta * L * a, axis=-1)
        assert np.abs(depth.max(axis=0)).max() < 1e-6
    assert 0 < missing[2] < missing[1] / 3.5 < missing[0] / 12


def test_frame_and_rotors_of_a_module_are_closed_and_of_the_right_volume() -> None:
    module = Module()
    body, discs = closed(frame(module)), closed(join(rotor_discs(module)))
    assert body.is_watertight
    assert body.volume == pytest.approx(FRAME, rel=1e-12)
    assert discs.is_watertight
    assert discs.volume == pytest.approx(DISCS, rel=4e-3)  # 48 sides
    np.testing.assert_allclose(
        discs.bounds,
        [[-a, -a, -h] for a, h in [(0.1 / 2**0.5 + 0.05, 0.01)]] * np.array([[1], [-1]]),
        atol=1e-4,
    )


def test_a_frame_of_the_modules_own_takes_the_place_of_hub_and_arms() -> None:
    design = random_design(Topology.from_key("a10"), 1, {"module": {"body": OWN_FRAME}})
    at = platform(design)
    right = 0.12 * 0.09 * 0.06 / 6 + 0.07 * 0.07 * 0.03
    middle = (0.12 * 0.09 * 0.06 / 6 * WEDGE.mean(axis=0) + 0.07 * 0.07 * 0.03 * BLOCK.mean(axis=0)) / right
    for i in range(2):
        mesh = in_place(loaded_glb(design), f"frame_{i}")
        assert mesh.is_watertight
        assert mesh.volume == pytest.approx(right, rel=1e-5)
        np.testing.assert_allclose(mesh.center_mass, at.poses.R[i] @ middle + at.poses.p[i], atol=1e-6)


@pytest.mark.parametrize("topology", drawn_trees(), ids=lambda tree: tree.key)
def test_a_scene_read_back_has_every_module_and_envelope_in_place(topology: Topology) -> None:
    design = random_design(topology, 4)
    at, module = platform(design), design.task.module
    scene = loaded_glb(design)
    volume = cone_sphere_volume(module.envelope.length, module.envelope.start_radius, module.envelope.end_radius)
    for i, (p, R) in enumerate(zip(at.poses.p, at.poses.R, strict=True)):
        for node, centre, right in (
            (f"frame_{i}", p, FRAME),
            (f"rotors_{i}", p, DISCS),
            (f"airflow_{i}", p - 0.5 * module.envelope.length * R[:, 2], volume),
        ):
            mesh = in_place(scene, node)
            assert mesh.is_watertight
            assert mesh.volume == pytest.approx(right, rel=5e-3)
            if not node.startswith("airflow"):
                np.testing.assert_allclose(mesh.center_mass, centre, atol=1e-6)
        tip = p - (module.reach) * R[:, 2]  # the far end of the volume
        assert np.linalg.norm(in_place(scene, f"airflow_{i}").vertices - tip, axis=1).min() < 1e-6
    np.testing.assert_allclose(in_place(scene, "end_effector_0").center_mass, design.end_effector_m, atol=1e-6)
    np.testing.assert_allclose(in_place(scene, "centre_of_mass_0").center_mass, at.p_com, atol=1e-6)


@pytest.mark.parametrize("topology", drawn_trees(), ids=lambda tree: tree.key)
def test_a_printed_platform_is_closed_and_in_millimetres(topology: Topology) -> None:
    design = random_design(topology, 4)
    mesh = trimesh.load_mesh(io.BytesIO(stl(design)), file_type="stl")
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(1e9 * topology.n * (FRAME + DISCS), rel=4e-3)
    np.testing.assert_allclose(mesh.center_mass, 1e3 * platform(design).poses.p.mean(axis=0), atol=1e-3)


@pytest.mark.parametrize("topology", drawn_trees(), ids=lambda tree: tree.key)
def test_the_rod_is_a_closed_part_of_the_platform(topology: Topology) -> None:
    bare = random_design(topology, 4)
    design = with_rod(bare)
    start, tip = rod_ends(design)
    rod = in_place(loaded_glb(design, parts="platform"), "rod_0")
    assert rod.is_watertight
    right = cone_sphere_volume(float(np.linalg.norm(tip - start)), 0.005, 0.005)
    assert rod.volume == pytest.approx(right, rel=5e-3)
    np.testing.assert_allclose(rod.center_mass, (start + tip) / 2, atol=1e-5)
    printed, without = (trimesh.load_mesh(io.BytesIO(stl(one)), file_type="stl") for one in (design, bare))
    assert printed.is_watertight
    assert printed.volume - without.volume == pytest.approx(1e9 * right, rel=5e-3)


def test_parts_are_chosen() -> None:
    design = random_design(Topology.from_key("a10"), 0)
    assert set(loaded_glb(design, parts="platform").geometry) == {"frame", "rotors"}
    assert set(loaded_glb(design, parts="airflow").geometry) == {"airflow"}
    volumes = {
        parts: trimesh.load_mesh(io.BytesIO(stl(design, parts)), file_type="stl").volume
        for parts in ("platform", "airflow", "all")
    }
    balls = 1e9 * 2 * 4 / 3 * math.pi * 0.02**3
    assert volumes["all"] == pytest.approx(volumes["platform"] + volumes["airflow"] + balls, rel=1e-3)


def test_regions_at_the_target_are_where_the_task_has_them() -> None:
    exposure = [
        {"kind": "local", "radius": 0.2},
        {"kind": "directional", "radius": 0.1, "segments": [[1.0, 0.0, 0.0], [0.0, 0.0, -2.0]]},
        {"kind": "directional", "radius": 0.1, "along": "end_effector", "length": 1.5},
        {"kind": "exterior", "half_angle_deg": 30.0, "axis": [0.0, 1.0, 0.0]},
        {"kind": "exterior", "half_angle_deg": 90.0, "axis": "com"},
        {"kind": "local", "box": [0.4, 0.3, 0.2]},
    ]
    design = random_design(Topology.from_key("a10"), 0, {"exposure": exposure})
    tip, p_E = np.array(design.end_effector_m), platform(design).p_e
    scene = loaded_glb(design)
    ball, paths, outwards, cone, plane, box = (in_place(scene, f"exposure_{e}_0") for e in range(6))
    np.testing.assert_allclose(box.bounds - tip, np.outer([-1, 1], [0.2, 0.15, 0.1]), atol=1e-6)
    assert ball.volume == pytest.approx(cone_sphere_volume(0, 0.2, 0.2), rel=8e-3)
    np.testing.assert_allclose(ball.center_mass, tip, atol=1e-6)
    np.testing.assert_allclose(paths.bounds - tip, [[-0.1, -0.1, -2.1], [1.1, 0.1, 0.1]], atol=1e-3)
    assert paths.volume == pytest.approx(
        cone_sphere_volume(1, 0.1, 0.1) + cone_sphere_volume(2, 0.1, 0.1), rel=5e-3
    )
    np.testing.assert_allclose(outwards.center_mass, tip + 0.75 * p_E / np.linalg.norm(p_E), atol=1e-3)
    from_apex = cone.vertices - tip
    outside = np.linalg.norm(from_apex, axis=1) > 1e-6
    along = from_apex[outside, 1] / np.linalg.norm(from_apex[outside], axis=1)
    np.testing.assert_allclose(along, math.cos(math.radians(30)), atol=1e-6)
    np.testing.assert_allclose((plane.vertices - tip) @ p_E, 0, atol=1e-6)


def test_colours_are_those_of_the_pictures() -> None:
    scene = loaded_glb(random_design(Topology.from_key("a10"), 0))
    material = scene.geometry["airflow"].visual.material
    assert material.alphaMode == "BLEND"
    linear = np.array(material.baseColorFactor) / 255
    shown = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    np.testing.assert_allclose(shown[:3], [0xCC / 255, 0x79 / 255, 0xA7 / 255], atol=5e-3)
    assert linear[3] == pytest.approx(0.2, abs=3e-3)


def test_solids_of_modules_of_two_millimetres_are_closed():
    """Places within 1e-8 of each other must not become one where everything is small."""
    end = np.array([0.0, 0.0, -2.6e-2])
    small = cone_sphere(np.zeros(3), 2e-3, end, 4.3e-3), cone_sphere(np.zeros(3), 1e-6, end, 1e-6)
    for mesh in map(closed, small):
        assert mesh.is_watertight
        assert mesh.volume > 0


# ---- Convex target regions in pictures, solids, words, and where the report marks the least clearance.

CUBE = np.array(list(product((-1.0, 1.0), repeat=3)))
REGIONS = [
    {"kind": "local", "box": [0.4, 0.3, 0.2]},
    {"kind": "local", "vertices": (0.1 * CUBE[[0, 1, 2, 4, 7]] + [0.3, 0.0, 0.2]).tolist()},
]
DESIGN = fan({"exposure": REGIONS})


def test_pictures_show_regions() -> None:
    figures = [figure_of(DESIGN), figure_of(fan()), task_figure(DESIGN.task), task_figure(fan().task)]
    try:
        with_regions, without = (len(figure.axes[0].collections) for figure in figures[:2])
        assert with_regions == without + 2 * len(REGIONS)  # faces and edges
        with_regions, without = (len(figure.axes[0].patches) for figure in figures[2:])
        assert with_regions == without + len(REGIONS)
    finally:
        for figure in figures:
            plt.close(figure)
    assert any("keep-out" in part.name for part in scene(DESIGN, platform(DESIGN)))
