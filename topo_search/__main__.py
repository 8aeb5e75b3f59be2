"""Entry point of `topo-search` and `python -m topo_search`."""

from typing import NoReturn

from topo_search.supervisor import supervise


def main() -> NoReturn:
    """Run the command line so that it can be stopped at any moment, even while it imports."""
    supervise(_command)


def _command() -> None:
    import logging

    logging.disable()  # libraries log, for example, the traceback of a lost connection

    from topo_search.cli import main as command

    command()


if __name__ == "__main__":
    main()
