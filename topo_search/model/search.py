"""What the search may do, and what it asks of the solver beyond the task's own words."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, Tag, model_validator

from topo_search.model.value import NonNegative, Positive, Value, one_of, refuse

BodyClearance = Annotated[
    Annotated[Positive, Tag("<number>")] | Annotated[Literal[False], Tag("<false>")],
    one_of("must be a length or false"),
]


class Search(Value):
    """What the search may do, and what it asks of the solver."""

    root: Literal["free", "paper"] = "free"
    """`free`: any root orientation; `paper`: psi = 0 and both angles within +-90 deg."""
    connectors: Literal["aligned", "any"] = "aligned"
    """`aligned`: parent port a meets child port a + 2; `any`: any port of the child."""
    # Of 1,000 designs solved without a margin the worst overlaps by 8.5e-10 m; 1.1e-8 m would have kept all of them
    # above the audit's floor (tests/benchmarks/smooth_error.py). The default is far more: it costs 0.013 % of the
    # effort where that was measured, and leaves room for larger modules and for checks less exact than the audit.
    margin: NonNegative = 1.0e-4
    """Clearance that the solver adds to every geometric requirement [m]."""
    interference: Literal["airflow", "separation"] = "airflow"
    """`separation`: the paper's ablation, a minimum distance instead of envelope clearance."""
    separation: Positive | None = None
    """Minimum distance of module centres in the ablation [m]; default: 2 arm_length."""
    peak_input: Annotated[Positive, Field(le=1, exclude_if=lambda given: given == 1.0)] = 1.0
    """Largest squared speed of a rotor in a load case, as a share of its limit."""
    body_clearance: BodyClearance | None = None
    """Least distance between centres not bolted together [m]; default: 2 (arm_length + rotor_radius); or false."""

    @model_validator(mode="after")
    def _no_body_clearance_in_the_ablation(self) -> Self:
        if self.interference == "separation" and self.body_clearance:
            text = f'must be false or left out with interference = "separation", but got {self.body_clearance}'
            refuse("Search", (("body_clearance",), text))
        return self
