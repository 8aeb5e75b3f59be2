"""`python -m topo_search` is the command `topo-search`."""

from topo_search.cli import main

if __name__ == "__main__":
    main()
