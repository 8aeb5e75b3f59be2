"""`topo-search airflow`: what encloses a speed, that nothing smaller does, and speeds on envelopes."""

import base64
import json
import math
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
import trimesh
from commands import invoke
from scipy.optimize import differential_evolution
from scipy.spatial import ConvexHull
from suites import few
from wording import says

from topo_search.compose.binding import enclose_speed
from topo_search.export.air_field import air_field, air_surface, npz, vti
from topo_search.model import Design, Module
from topo_search.model.air import SpeedEnvelope
from topo_search.model.files import read_json, to_toml
from topo_search.model.task_file import read_task
from verify import audit
from verify.air.bound import case_jets
from verify.air.envelope import enclose, envelope_air, volume
from verify.air.jets import jets, speeds
from verify.kinematics import platform
from verify.requirements import Scene

WEIGHT = 0.24 * 9.81
ROTORS = 0.1 * np.array([[1.0, 1, 0], [-1, 1, 0], [-1, -1, 0], [1, -1, 0]]) / math.sqrt(2)


def answer(*words: str) -> dict[str, float]:
    return dict(json.loads(invoke("airflow", *words, "--json").stdout))


def blown(module: Module, thrust: float, x: np.ndarray) -> np.ndarray:
    """Return the air speed at points [m] of one module with arms of 0.1 m at the origin."""
    u = np.full((1, 4), thrust / (4 * module.thrust_coefficient))
    air = jets(module, 1.2, np.zeros((1, 3)), np.eye(3)[None], ROTORS[None] / 0.1, u)
    return speeds(air, x / 0.1)[:, 0]


def holds(found: SpeedEnvelope, x: np.ndarray) -> np.ndarray:
    """Return which points [m] are in one of many balls."""
    growth = math.tan(math.radians(found.spread_angle_deg) / 2)
    t = np.linspace(0, (found.reach_m - found.start_radius_m) / (1 + growth), 2_000)
    beside, z = np.hypot(x[:, 0], x[:, 1]), -x[:, 2]
    return np.array(
        [
            (np.hypot(r, a - t) <= (found.start_radius_m + growth * t) * (1 + 1e-5)).any()
            for r, a in zip(beside, z, strict=True)
        ]
    )


def around(rng: np.random.Generator, size: float, k: int) -> np.ndarray:
    """Return points that are denser towards the rotors [m]."""
    return size * 10 ** rng.uniform(-3, 0.2, (k, 1)) * rng.uniform(-1, 1, (k, 3)) * [0.2, 0.2, 1] + ROTORS[
        rng.integers(4, size=k)
    ] * rng.uniform(0, 1.5, (k, 1))


@pytest.mark.parametrize("seed", few(range(5), 1))
def test_all_air_of_the_speed_is_inside_and_no_envelope_is_smaller(seed: int) -> None:
    """Slow air, fast air, rotors of all sizes; scipy computes the least volume around a section's points."""
    rng = np.random.default_rng(seed)
    module = Module(body={"rotor_radius": 0.1 * 10 ** rng.uniform(-1.2, 0.4)})
    top = 2 * math.sqrt(WEIGHT / (8 * 1.2 * math.pi * module.body.rotor_radius**2))
    speed = top * 10 ** rng.uniform(-1.5, -0.1)
    found = enclose(module, 1.2, WEIGHT, speed)
    x = around(rng, 1.2 * found.reach_m, 60_000)
    x = x[blown(module, WEIGHT, x) >= speed]
    assert len(x) > 300
    assert holds(found, x).all()
    assert found.least_volume_m3 < found.volume_m3 < 1.01 * found.least_volume_m3

    wide = found.start_radius_m + found.reach_m * math.tan(math.radians(found.spread_angle_deg) / 2)
    z, r = np.meshgrid(np.linspace(-wide, found.reach_m, 500), np.linspace(0, 1.05 * wide, 300))
    ways = ((1.0, 0.0), (math.sqrt(0.5), math.sqrt(0.5)))
    grids = (np.stack([r * cos, r * sin, -z], axis=2).reshape(-1, 3) for cos, sin in ways)
    fast = np.any([blown(module, WEIGHT, grid) >= speed for grid in grids], axis=0).reshape(z.shape)
    section = np.column_stack([z[fast], r[fast]])
    z, r = section[ConvexHull(section).vertices].T

    def size(sizes: np.ndarray) -> float:
        """Return the volume with two radii and a length; points that are outside cost."""
        a, b, length = sizes
        g = min(max((b - a) / length, 0.0), 1.0)
        t = np.clip(z + r * g / math.sqrt(max(1 - g * g, 1e-9)), 0, length)
        excess = max(float((np.hypot(r, z - t) - a - g * t).max()), 0.0)
        return (
            float(volume(a, g, length)) * (1 + 100 * excess / max(a, b))
            + 10 * excess * found.volume_m3 / found.reach_m
        )

    far = found.reach_m
    least = differential_evolution(size, [(1e-3, far), (1e-3, far), (1e-3, far)], seed=0, maxiter=60, tol=1e-5).fun
    assert least < found.volume_m3 < 1.04 * least  # the points do not reach the surface


@pytest.mark.parametrize(
    ("speed", "length", "width"), [(1.0, 10.136, 0.4373), (2.0, 4.486, 0.2187), (3.0, 2.603, 0.1458)]
)
def test_the_far_field_of_the_default_module_by_hand(speed: float, length: float, width: float) -> None:
    """The contour U = V of the published jet, from s = 2.5, is inside, and its end is the end."""
    far = 10.11 * math.sqrt(WEIGHT / (8 * 1.2 * math.pi * 0.05**2))
    s = np.linspace(2.5, far / speed - 5.817, 4_000)
    r = 0.0767 * (s + 5.817) * np.sqrt((np.sqrt(far / (s + 5.817) / speed) - 1) / (math.sqrt(2) - 1))
    assert 0.2 * s[-1] == pytest.approx(length, abs=6e-4)
    assert 0.2 * r.max() == pytest.approx(width, abs=6e-5)
    found = enclose(Module(), 1.2, WEIGHT, speed)
    assert holds(found, 0.2 * np.column_stack([r, 0 * r, -s])).all()
    assert found.reach_m == pytest.approx(0.2 * s[-1], rel=2e-3)


@pytest.mark.parametrize("spread", few([0.0, 50.0, 10.0], 2))
def test_speeds_of_a_given_envelope_are_the_largest_that_samples_find(spread: float) -> None:
    module = Module(airflow={"spread_angle_deg": spread})
    stated = envelope_air(module, 1.2, WEIGHT)
    given, rng = module.envelope, np.random.default_rng(0)
    g = given.growth / given.length
    cos, phi = math.sqrt(1 - g * g), rng.uniform(0, 2 * math.pi, 200_000)

    def largest(z: np.ndarray, r: np.ndarray) -> float:
        return float(blown(module, WEIGHT, np.column_stack([r * np.cos(phi), r * np.sin(phi), -z])).max())

    t = given.length * rng.uniform(0, 1, len(phi))
    radius = given.start_radius + g * t
    assert largest(t - g * radius, cos * radius) == pytest.approx(stated.side_m_s, rel=5e-3)
    below = np.where(t - g * radius >= 0.5, radius, 1e3)
    assert largest(t - g * radius, cos * below) == pytest.approx(stated.side_merged_m_s, rel=5e-3)
    angle = rng.uniform(-math.asin(g), math.pi / 2, len(phi))
    end = given.end_radius
    assert largest(given.length + end * np.sin(angle), end * np.cos(angle)) == pytest.approx(
        stated.end_m_s, rel=5e-3
    )
    plane = given.start_radius / cos + rng.exponential(0.05, len(phi)) * (rng.random(len(phi)) < 0.9)
    assert largest(0 * plane, plane) == pytest.approx(stated.rotor_plane_m_s, rel=5e-3)


def test_speeds_go_with_the_root_of_thrust_over_density(tmp_path) -> None:
    """Speeds in hover, times sqrt(2.5) at 2.5 times the thrust, are halved in air of four times the density."""
    (tmp_path / "dense.toml").write_text(
        "name = 'dense'\nmodules = 2\nair_density = 4.8\n[[load_cases]]\ncom = { force = [0.0, 0.0, 1.0] }\n"
        "[module]\ntorque_coefficient = 3.1e-9\n"
    )
    hover = answer("--speed", "4")
    full = answer("--speed", str(4 * math.sqrt(2.5)), "--at", "full")
    dense = answer(str(tmp_path / "dense.toml"), "--speed", "2", "--at", "1.0")
    assert full["thrust_to_weight"] == 2.5
    assert full["thrust_N"] == pytest.approx(2.5 * WEIGHT)
    for name in ("start_radius_m", "reach_m"):
        assert hover[name] == pytest.approx(full[name], rel=5e-3) == pytest.approx(dense[name], rel=5e-3)
    assert hover["side_m_s"] == pytest.approx(2 * dense["side_m_s"], rel=2e-3)
    assert full["end_m_s"] == pytest.approx(math.sqrt(2.5) * hover["end_m_s"], rel=2e-3)


def test_air_that_is_nowhere_so_fast_is_refused_with_the_fastest() -> None:
    refused = invoke("airflow", "--speed", "12", status=2)
    fastest = blown(Module(), WEIGHT, around(np.random.default_rng(0), 1.0, 200_000)).max()
    assert says(refused.stderr, "speed", "reached")
    numbers = [float(word) for word in refused.stderr.replace(")", " ").split() if word.replace(".", "").isdigit()]
    assert any(fastest * 0.99 < number < fastest * 1.03 for number in numbers)
    invoke("airflow", "--speed", "12", "--at", "full")


@pytest.mark.parametrize(
    "words", ["--speed 0", "--speed -1", "--speed nan", "--at hover", "--speed 2 --at 2.6", "--speed 2 --at 0"]
)
def test_bad_options_are_refused(words: str) -> None:
    invoke("airflow", *words.split(), status=2)


def test_a_task_may_state_its_envelope_against_regions_by_a_speed(tmp_path: Path) -> None:
    """It is replaced by the cone-sphere that the command prints, and that between modules stays."""
    found = answer("push-local", "--speed", "2")
    task = enclose_speed(read_task("push-local", ("module.airflow.speed=2.0",)))
    module = task.resolve(4).module
    regions = module.airflow.regions
    assert (regions.start_radius, regions.reach) == (found["start_radius_m"], found["reach_m"])
    assert module.envelope == Module().envelope
    assert module.region_envelope.start_radius == found["start_radius_m"]
    file = tmp_path / "task.toml"
    file.write_text(to_toml(task))
    assert read_task(file) == task
    assert "11.1 m/s" in invoke("check", "push-local").stdout
    told = invoke("check", "push-local", "--set", "module.airflow.speed=2.0").stdout
    assert "11.1 m/s" not in told
    assert "21.9 cm at the module" in told


def test_the_envelope_against_regions_encloses_all_slipstreams_by_default() -> None:
    module = Module.model_validate({"airflow": {"regions": {}}})
    assert module.region_envelope.start_radius == pytest.approx(module.arm_length + module.body.rotor_radius)
    assert Module.model_validate({"airflow": {"regions": False}}).region_envelope == Module().envelope


@pytest.mark.parametrize(
    "bad", ["speed=0.0", "speed=-1.0", "speed=50.0", "at=9.0", "at=fall", "regions.start_radius=2.0"]
)
def test_a_bad_envelope_against_regions_is_refused(bad: str) -> None:
    given = [] if bad.startswith("speed") else ["--set", "module.airflow.speed=2.0"] * bad.startswith("at")
    refused = invoke("check", "push-local", "--set", f"module.airflow.{bad}", *given, status=2)
    assert bad.split("=")[0].split(".")[0] in refused.stderr


# ---- Air speeds on a grid: the values of the model, and files that others read.

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
    at_tip = speeds(blown, scene.tip[None]).sum()
    assert surface.mesh.contains([design.end_effector_m])[0] == (at_tip > 1.5)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["a.glb", "--air-speed", "1"], ""),
        (["a.png", "--air-speed", "2", "--load-case", "1"], ""),
        (["a.stl", "--air-speed", "1"], "--air-speed: applies only to"),
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
