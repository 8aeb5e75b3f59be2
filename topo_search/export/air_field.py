"""Air speeds on a grid, for NumPy (.npz) and ParaView (.vti, image data of VTK), and surfaces of equal speed."""

from __future__ import annotations

import base64
import io
from typing import NamedTuple
from xml.sax.saxutils import quoteattr

import numpy as np
from manifold3d import Manifold
from numpy.typing import NDArray
from trimesh import Trimesh

from topo_search.model import BadInput, Design
from topo_search.model.arrays import Array
from topo_search.model.proven import upper_text
from verify.air.bound import case_jets
from verify.air.jets import speeds
from verify.kinematics import platform
from verify.requirements import Scene

AROUND, BELOW = 0.5, 2.0
"""Room around modules and end-effector, and along their jets [m]."""


class AirField(NamedTuple):
    """Air speeds of a design, from the root's centre in the axes of the task."""

    origin: NDArray[np.float64]
    """First point of the grid, shape (3,) [m]."""
    step: float
    """Distance of neighbours [m]."""
    cases: dict[str, NDArray[np.float32]]
    """Sum of the modules' speeds in every load case, shape (nx, ny, nz) [m/s]."""


class AirSurface(NamedTuple):
    """The surface around all air of a load case that is faster than some speed."""

    words: str
    """Speed and load case."""
    mesh: Trimesh
    """From the root's centre in the axes of the task, closed where its room ends [m]."""


def air_field(design: Design, points: int = 200_000) -> AirField:
    """Return the air of a design around its modules, its end-effector and its jets, at no more than some points.

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
    """Return where the air of a load case has a speed [m/s], from the speeds at about so many points.

    Raises:
        BadInput: there is no such load case, or no air is so fast in it.
    """
    air = _Air(design)
    if load_case >= len(air.cases):
        rule = f"must be one of the load cases 0 to {len(air.cases) - 1}, but got {load_case}"
        raise BadInput("--load-case", rule)
    name, box = list(air.cases)[load_case], [*air.low.tolist(), *air.high.tolist()]
    edge = float((2 * np.prod(air.high - air.low) / points) ** (1 / 3))  # two points a cube
    grid: list[tuple[float, ...]] = []

    def note(*point: float) -> float:
        grid.append(point)
        return -1.0

    Manifold.level_set(note, box, edge)  # says where it asks, for a call a point would take minutes
    speeds = air.speeds(name, np.array(grid))
    if speeds.max() <= speed:
        rule = f"must be less than {upper_text(speeds.max(), 3)} m/s, the fastest air in {name}, but got {speed:g}"
        raise BadInput("--air-speed", rule)
    over = dict(zip(grid, (speeds - speed).tolist(), strict=True))
    mesh = Manifold.level_set(lambda *point: over[point], box, edge).to_mesh()
    surface = Trimesh(mesh.vert_properties[:, :3], mesh.tri_verts)
    return AirSurface(f"air faster than {speed:g} m/s, {name}", surface)


class _Air:
    """The air of a design in some room."""

    def __init__(self, design: Design) -> None:
        placed = platform(design)
        scene = Scene(design, placed)
        W, self._l_arm = placed.poses.p, scene.l_arm
        self._middle = W.mean(axis=0)
        self.cases = dict(case_jets(scene))
        points = np.concatenate([W, W - BELOW * placed.poses.z, [self._middle + self._l_arm * scene.p_E]])
        self.low, self.high = points.min(axis=0) - AROUND, points.max(axis=0) + AROUND

    def speeds(self, case: str, x: Array) -> Array:
        """Return the sum of the modules' speeds at points from the root's centre, (m, 3) [m]."""
        blown = self.cases[case]
        parts = np.array_split((x - self._middle) / self._l_arm, max(1, len(x) * len(blown.centres) // 50_000))
        return np.concatenate([speeds(blown, part).sum(axis=1) for part in parts])


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
