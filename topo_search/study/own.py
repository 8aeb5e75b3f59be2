"""What a user brought to a run beside its task, as far as its folder keeps it: names and digests, no code."""

from __future__ import annotations

from typing import Any

from topo_search.model.design import Stated, Versioned
from topo_search.model.value import Value


class Own(Value):
    """What a user brought to a run beside its task, as far as it tells one run from another."""

    topologies: tuple[str, ...] | None = None
    """Keys of the only candidates, in ascending order; None: all trees."""
    near: tuple[str, ...] = ()
    """Digests of the designs that every candidate starts from."""
    constraints: tuple[Stated, ...] = ()
    sampler: Versioned | None = None

    @property
    def unversioned(self) -> tuple[str, ...]:
        """Names of functions of which nobody can tell whether they are still the same."""
        named: tuple[Versioned, ...] = (
            self.constraints if self.sampler is None else (*self.constraints, self.sampler)
        )
        return tuple(one.name for one in named if one.version is None)

    @property
    def fixes(self) -> dict[str, Any]:
        """What of it fixes the value of a row."""
        given = self.model_dump(mode="json", include={"near", "constraints"})
        return {name: value for name, value in given.items() if value}

    @property
    def telling(self) -> str | None:
        """Name of a constraint that may tell modules apart by their numbers."""
        return next((one.name for one in self.constraints if one.invariant == "none"), None)

    @property
    def handed(self) -> str | None:
        """Name of a constraint that may tell a platform from its mirror image."""
        return next((one.name for one in self.constraints if one.invariant != "mirror"), None)


NOTHING = Own()
