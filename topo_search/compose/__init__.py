"""The Python interface: solver, audit and search combined. The command line calls it too."""

from topo_search.compose.asking import airflow, capability, check, fly
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
    solve,
    view,
    write_report,
)
from topo_search.compose.rounding import NotClear, round_angles
from topo_search.compose.searching import check_proofs, prove, search
