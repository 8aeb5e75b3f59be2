"""Air speeds on a grid, for NumPy (.npz) and ParaView (.vti, image data of VTK), and surfaces of equal speed."""

import base64
import io
from typing import NamedTuple
from xml.sax.saxutils import quoteattr

import numpy as np
from manifold3d import Manifold
from numpy.typing import NDArray
from trimesh import Trimesh

from topo_search.model import Array, BadInput, Design
from topo_search.model.proven import upper_text
from verify.air.bound import case_jets
from verify.air.jets import speeds
from verify.kinematics import platform
from verify.requirements import Scene

AROUND, BELOW = 0.5, 2.0
"""Margin around modules, jets and end-effector; length of the jets that is included [m]."""


class AirField(NamedTuple):
    """Air speeds of a design on a grid, from the root's centre in the axes of the task."""

    origin: Array
    """First point of the grid, shape (3,) [m]."""
    step: float
    """Grid spacing [m]."""
    cases: dict[str, NDArray[np.float32]]
    """Sum of the modules' air speeds in each load case, shape (nx, ny, nz) [m/s]."""


class AirSurface(NamedTuple):
    """The surface that encloses all air of a load case above a speed."""

    words: str
    """Speed and load case, in words."""
    mesh: Trimesh
    """From the root's centre in the axes of the task, closed at the boundary of the box [m]."""


def air_field(design: Design, points: int = 200_000) -> AirField:
    """Return the air speeds of a design around its modules, jets and end-effector, on at most `points` points.

    The speeds are those of `verify.air.jets`: time averages in free air.
    """
    air = _Air(design)
    low, high = air.low, air.high
    step = float((np.prod(high - low) / points) ** (1 / 3))
    while np.prod(counts := np.floor((high - low) / step).astype(int) + 1) > points:
        step *= 1.01
    grid = np.stack(np.meshgrid(*(low[a] + step * np.arange(counts[a]) for a in range(3)), indexing="ij"), axis=-1)
    fields = {name: air.speeds(name, grid.reshape(-1, 3)).astype(np.float32) for name in air.cases}
    return AirField(low, step, {name: field.reshape(tuple(counts)) for name, field in fields.items()})


def air_surface(design: Design, speed: float, load_case: int = 0, points: int = 100_000) -> AirSurface:
    """Return the surface of equal air speed [m/s] in a load case, computed from about `points` points.

    Raises:
        BadInput: there is no such load case, or its air is slower everywhere.
    """
    air = _Air(design)
    if load_case >= len(air.cases):
        rule = f"must be one of the load cases 0 to {len(air.cases) - 1}, but got {load_case}"
        raise BadInput("--load-case", rule)
    name, box = list(air.cases)[load_case], [*air.low.tolist(), *air.high.tolist()]
    edge = float((2 * np.prod(air.high - air.low) / points) ** (1 / 3))  # a cell has two points
    grid: list[tuple[float, ...]] = []

    def record(*point: float) -> float:
        grid.append(point)
        return -1.0

    # level_set() evaluates point by point, which takes minutes, so the points are recorded and evaluated at once
    Manifold.level_set(record, box, edge)
    speeds = air.speeds(name, np.array(grid))
    if speeds.max() <= speed:
        rule = f"must be less than {upper_text(speeds.max(), 3)} m/s, the fastest air in {name}, but got {speed:g}"
        raise BadInput("--air-speed", rule)
    excess = dict(zip(grid, (speeds - speed).tolist(), strict=True))
    mesh = Manifold.level_set(lambda *point: excess[point], box, edge).to_mesh()
    surface = Trimesh(mesh.vert_properties[:, :3], mesh.tri_verts, process=False)  # merging would pinch
    return AirSurface(f"air faster than {speed:g} m/s, {name}", surface)


class _Air:
    """The jets of a design in all load cases, and the box around them."""

    def __init__(self, design: Design) -> None:
        poses = platform(design)
        scene = Scene(design, poses)
        p, z, self._l_arm = poses.p, poses.z, scene.l_arm
        self._middle = p.mean(axis=0)
        self.cases = dict(case_jets(scene))
        points = np.concatenate([p, p - BELOW * z, [self._middle + self._l_arm * scene.tip]])
        self.low, self.high = points.min(axis=0) - AROUND, points.max(axis=0) + AROUND

    def speeds(self, case: str, x: Array) -> Array:
        """Return the sum of the modules' air speeds [m/s] at points from the root's centre, (m, 3) [m]."""
        jets = self.cases[case]
        parts = np.array_split((x - self._middle) / self._l_arm, max(1, len(x) * len(jets.centres) // 50_000))
        return np.concatenate([speeds(jets, part).sum(axis=1) for part in parts])


def air_file(design: Design, suffix: str) -> str | bytes:
    """Return the content of a .npz or .vti file of a design's air; ValueError for another suffix."""
    if suffix not in (".npz", ".vti"):
        raise ValueError(f"the file's name must end in .npz or .vti, but ends in {suffix!r}")
    return (vti if suffix == ".vti" else npz)(air_field(design))


def npz(field: AirField) -> bytes:
    """Return the content of an .npz file: `case` (K,), `speed_m_s` (K, nx, ny, nz), `origin_m` (3,), `step_m`."""
    stream = io.BytesIO()
    speed = np.stack(list(field.cases.values()))
    cases = np.array(list(field.cases))
    np.savez_compressed(stream, case=cases, speed_m_s=speed, origin_m=field.origin, step_m=field.step)
    return stream.getvalue()


def vti(field: AirField) -> str:
    """Return the text of a .vti file: an array of point data for every load case."""
    shape = next(iter(field.cases.values())).shape
    extent = " ".join(f"0 {count - 1}" for count in shape)
    arrays = []
    for name, speed in field.cases.items():
        data = speed.ravel(order="F").astype("<f4").tobytes()
        packed = base64.b64encode(np.uint32(len(data)).tobytes() + data).decode()
        label = quoteattr(f"{name} [m/s]")
        arrays.append(f'<DataArray type="Float32" Name={label} format="binary">{packed}</DataArray>')
    origin = " ".join(f"{x:.9g}" for x in field.origin)
    return (
        '<?xml version="1.0"?>\n<VTKFile type="ImageData" version="0.1" byte_order="LittleEndian">\n'
        f'<ImageData WholeExtent="{extent}" Origin="{origin}" Spacing="{" ".join([f"{field.step:.9g}"] * 3)}">\n'
        f'<Piece Extent="{extent}"><PointData>\n' + "\n".join(arrays) + "\n</PointData></Piece>\n"
        "</ImageData>\n</VTKFile>\n"
    )
