"""Air speeds on a grid: the values of the model, and files that others read."""

import base64
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
import trimesh
from commands import invoke
from suites import few

from topo_search.export.air_field import air_field, air_surface, npz, vti
from topo_search.model import Design
from topo_search.model.files import read_json
from verify import audit
from verify.air.bound import case_jets
from verify.air.jets import speeds
from verify.kinematics import platform
from verify.requirements import Scene

DESIGN = Path(__file__).parent / "designs" / "wall-push.json"


def test_the_grid_has_the_speed_of_the_audit_at_the_tip(tmp_path: Path) -> None:
    design = read_json(Design, DESIGN)
    field = air_field(design, points=60_000)
    found = audit(design).air
    assert list(field.cases) == [case.name for case in found.cases]
    nearest = np.round((np.array(design.end_effector_m) - field.origin) / field.step).astype(int)
    for case in found.cases:
        around = field.cases[case.name][tuple(slice(at - 1, at + 2) for at in nearest)]
        assert around.min() <= case.tip_m_s * 1.01
        assert around.max() >= case.tip_m_s * 0.99
        assert field.cases[case.name].size <= 60_000
    (tmp_path / "air.npz").write_bytes(npz(field))
    with np.load(tmp_path / "air.npz") as read:
        assert read["speed_m_s"].shape == (2, *field.cases["load case 1 (hover)"].shape)
        assert float(read["step_m"]) == field.step


def test_the_image_data_of_vtk_has_x_first() -> None:
    field = air_field(read_json(Design, DESIGN), points=2_000)
    (image,) = ET.fromstring(vti(field)).iter("ImageData")
    nx, ny, nz = (int(image.attrib["WholeExtent"].split()[k]) + 1 for k in (1, 3, 5))
    for array, speed in zip(image.iter("DataArray"), field.cases.values(), strict=True):
        raw = base64.b64decode(array.text or "")
        assert int.from_bytes(raw[:4], "little") == len(raw) - 4 == 4 * nx * ny * nz
        read = np.frombuffer(raw[4:], "<f4").reshape(nz, ny, nx)
        np.testing.assert_array_equal(read.transpose(2, 1, 0), speed)


@pytest.mark.parametrize(("name", "status"), few([("air.npz", 0), ("air.txt", 2), ("air.vti", 0)], 2))
def test_the_command_writes_either_form(tmp_path: Path, name: str, status: int) -> None:
    words = ["export", str(DESIGN), "--format", "air", "--out", str(tmp_path / name)]
    result = invoke(*words, status=status)
    assert (tmp_path / name).exists() == (status == 0)
    if status:
        assert ".npz or .vti" in result.stderr


def test_a_surface_has_its_speed_and_is_closed() -> None:
    design = read_json(Design, DESIGN)
    surface = air_surface(design, 1.5, 1, points=30_000)
    assert surface.words == "air faster than 1.5 m/s, load case 1 (hover)"
    assert surface.mesh.is_volume
    placed = platform(design)
    scene = Scene(design, placed)
    (_, blown) = list(case_jets(scene))[1]
    low, high = surface.mesh.bounds
    corners = surface.mesh.vertices[((surface.mesh.vertices > low) & (surface.mesh.vertices < high)).all(axis=1)]
    found = speeds(blown, (corners - placed.poses.p.mean(axis=0)) / scene.l_arm).sum(axis=1)
    assert np.median(found) == pytest.approx(1.5, rel=0.05)
    at_tip = speeds(blown, scene.p_E[None]).sum()
    assert surface.mesh.contains([design.end_effector_m])[0] == (at_tip > 1.5)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["a.glb", "--air-speed", "1"], ""),
        (["a.png", "--air-speed", "2", "--load-case", "1"], ""),
        (["a.stl", "--air-speed", "1"], "--air-speed: applies only to glb, png and svg"),
        (["a.glb", "--load-case", "1"], "--load-case: applies only with --air-speed"),
        (["a.glb", "--air-speed", "1", "--load-case", "2"], "must be one of the load cases 0 to 1"),
        (["a.glb", "--air-speed", "50"], "must be less than"),
    ],
)
def test_the_command_draws_air(tmp_path: Path, words: list[str], said: str) -> None:
    name, *options = words
    out = tmp_path / name
    assert said in invoke("export", DESIGN, "--out", out, *options, status=2 if said else 0).stderr
    assert out.exists() == (not said)
    if out.exists() and name.endswith("glb"):
        assert "air" in trimesh.load_scene(out).geometry
