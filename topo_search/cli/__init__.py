"""The command line. Command modules import what they need when they run, so that `--help` answers at once."""

import itertools

import click

from topo_search.cli.experiment import experiment
from topo_search.cli.export import export
from topo_search.cli.fly import fly
from topo_search.cli.hardware import airflow, capability, kit
from topo_search.cli.run import run
from topo_search.cli.runs import audit, compare, list_runs, open_page, report, show
from topo_search.cli.solve import prove, solve
from topo_search.cli.tasks import check, examples, init, topologies

GROUPS = {
    "Task": (init, examples, check, topologies),
    "Search": (run, solve, prove, experiment),
    "Result": (audit, report, list_runs, show, open_page, compare),
    "Hardware": (kit, export, fly, airflow, capability),
}
"""Commands in the order of work."""


class OrderedGroup(click.Group):
    """A group whose help lists commands in the order of work, with untruncated summaries."""

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write a section for each group."""
        for title, commands in GROUPS.items():
            with formatter.section(title):
                rows = [(command.name or "", (command.help or "").partition("\n\n")[0]) for command in commands]
                formatter.write_dl(rows, col_max=12)


@click.group(
    cls=OrderedGroup,
    epilog="Example: topo-search run push",
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100, "show_default": True},
)
@click.version_option(package_name="topo-search")
def main() -> None:
    """Find the best topology of a modular aerial manipulator for a task, and audit it exactly."""


for command in itertools.chain(*GROUPS.values()):
    main.add_command(command)
