"""Keep what flights of two designs show, for the documentation.

    python tests/benchmarks/keep_flights.py

`tests/designs/push-a70010.json` has the least effort and nothing else, `tests/designs/wall-press.json` was asked
for reserves. Both are flown as `topo-search fly DESIGN --rotor-out` flies them. The answers go to
`notebooks/results/flight-NAME.json`, the plots to `notebooks/pictures/flight-NAME.png`.
"""

from __future__ import annotations

from pathlib import Path

from topo_search.model import Design
from topo_search.model.files import read_json, to_json, write_atomically
from topo_search.simulation.campaign import fly_all
from topo_search.simulation.files import plot
from topo_search.simulation.fly import Options

ROOT = Path(__file__).parents[2]
NAMES = ("push-a70010", "wall-press")


def main() -> None:
    """Fly both, and write what they show."""
    for name in NAMES:
        design = read_json(Design, ROOT / f"tests/designs/{name}.json")
        campaign = fly_all(design, Options(), rotor_out=True)
        write_atomically(ROOT / f"notebooks/results/flight-{name}.json", to_json(campaign.result))
        write_atomically(ROOT / f"notebooks/pictures/flight-{name}.png", plot(campaign.flown, campaign.result))


if __name__ == "__main__":
    main()
