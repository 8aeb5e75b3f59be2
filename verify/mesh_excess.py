"""Excess of target regions over the meshes that they are made from."""

from topo_search.model import MeshExcess
from verify.sections import Findings


def mesh_excess(found: Findings) -> tuple[MeshExcess, ...]:
    """Return by how much regions exceed the meshes that they are made from."""
    return tuple(
        MeshExcess(exposure=number, segment=segment, at_most_m=excess)
        for number, exposure in enumerate(found.scene.design.task.exposure)
        for segment, excess in exposure.mesh_excesses()
    )
