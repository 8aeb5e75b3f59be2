"""The command `topo-search`, which `python -m topo_search` is too."""

from typing import NoReturn

from topo_search.supervisor import supervise


def main() -> NoReturn:
    """Run the command line, from its first import on, such that it can be stopped at any moment."""
    supervise(_command)


def _command() -> None:
    import logging
    import os

    logging.disable()  # libraries would log, for example, the traceback of a lost connection

    from topo_search.supervisor import ONE_THREAD

    os.environ.update(ONE_THREAD)  # before NumPy loads: threads would cost more than proposals, and change sums

    from topo_search.cli import main as command

    command()


if __name__ == "__main__":
    main()
