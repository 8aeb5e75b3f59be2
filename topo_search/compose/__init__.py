"""Composition of solver, audit and search: the Python interface, which the command line calls too."""

from topo_search.compose.binding import BACKENDS, available_cores
from topo_search.compose.designs import (
    audit,
    audits,
    brackets_note,
    compare,
    figure,
    plot_platform,
    read_completed,
    read_design,
    round_angles,
    solve,
    write_report,
)
from topo_search.compose.searching import check_proofs, prove, search
