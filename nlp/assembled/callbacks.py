"""Functions of numbers handed to CasADi, without copying into its own arrays and back."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
import numpy as np

from topo_search.model.arrays import Array

Function = Callable[..., Array | float]
"""Takes all inputs, returns one output."""


class Evaluated(ca.Callback):
    """A CasADi function that a Python function evaluates: the nonzero entries in, the nonzero entries out."""

    def __init__(
        self,
        name: str,
        inputs: dict[str, ca.Sparsity],
        outputs: dict[str, ca.Sparsity],
        functions: Sequence[Function],
    ) -> None:
        """Name the inputs and outputs as CasADi's solvers expect them; a function for each output."""
        super().__init__()
        self._inputs, self._outputs, self._functions = inputs, outputs, functions
        self.error: Exception | None = None
        """Exception of the Python function, for the caller of the solver to re-raise."""
        self.construct(name, {})

    def get_n_in(self) -> int:
        """Return the number of inputs."""
        return len(self._inputs)

    def get_n_out(self) -> int:
        """Return the number of outputs."""
        return len(self._outputs)

    def get_name_in(self, index: int) -> str:
        """Return an input's name."""
        return list(self._inputs)[index]

    def get_name_out(self, index: int) -> str:
        """Return an output's name."""
        return list(self._outputs)[index]

    def get_sparsity_in(self, index: int) -> ca.Sparsity:
        """Return an input's pattern."""
        return list(self._inputs.values())[index]

    def get_sparsity_out(self, index: int) -> ca.Sparsity:
        """Return an output's pattern."""
        return list(self._outputs.values())[index]

    def has_eval_buffer(self) -> bool:
        """Tell CasADi to pass its memory instead of matrices."""
        return True

    def eval_buffer(self, inputs: Sequence[Any], outputs: Sequence[Any]) -> int:
        """Evaluate; CasADi owns the memory, and what is empty or not wanted is None."""
        given = [None if memory is None else np.frombuffer(memory) for memory in inputs]
        try:
            for memory, function in zip(outputs, self._functions, strict=True):
                if memory is not None:
                    np.frombuffer(memory)[:] = function(*given)
        except Exception as error:
            self.error = error  # Ipopt takes an exception for a point that cannot be evaluated, and goes on
            raise
        return 0
