"""The command line. Command modules import what they need when they run, so that `--help` answers at once."""

from __future__ import annotations

import click

from topo_search.cli.airflow import airflow
from topo_search.cli.audit import audit
from topo_search.cli.capability import capability
from topo_search.cli.check import check
from topo_search.cli.examples import examples
from topo_search.cli.experiment import experiment
from topo_search.cli.export import export
from topo_search.cli.fly import fly
from topo_search.cli.init import init
from topo_search.cli.kit import kit
from topo_search.cli.prove import prove
from topo_search.cli.report import report
from topo_search.cli.run import run
from topo_search.cli.solve import solve
from topo_search.cli.topologies import topologies


@click.group(
    epilog="Example: topo-search run push",
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.version_option(package_name="topo-search")
def main() -> None:
    """Find the best topology of a modular aerial manipulator for a task, and audit it exactly."""


for command in (
    run,
    solve,
    audit,
    prove,
    topologies,
    export,
    kit,
    fly,
    capability,
    airflow,
    report,
    experiment,
    examples,
    init,
    check,
):
    main.add_command(command)
