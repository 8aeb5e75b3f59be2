"""Keep the rows of experiments beside the notebooks, and write down there what they show.

    python tests/benchmarks/keep_results.py scaling=RUN-FOLDER scaling-direct=RUN-FOLDER ...

A run's rows and its description go to `notebooks/results/NAME.csv` and `NAME.json`; a row that was cut off while it
was written is left out. Then the text of that folder and the front page's pictures of it are made anew from all
that it holds; without arguments nothing else is.
"""

from __future__ import annotations

import argparse
import json
import textwrap
from pathlib import Path
from typing import Any

import pandas as pd

from topo_search.cli.experiment import NAMES
from topo_search.experiments import Settings, experiment, results

KEPT = Path(__file__).parents[2] / "notebooks" / "results"
SHOWN = ("scaling", "ablation")
"""Experiments whose picture is on the front page."""
HEAD = """# Results of the experiments

Rows of `topo-search experiment NAME`, a file each, with the command, versions and date that made them in the JSON
file beside it; rows called `direct` are of the paper's formulation written directly. The command, with `--out DIR`
behind it, makes the same rows but for seconds and megabytes, in `DIR/results.csv`, as long as the solver is the
same; `python tests/benchmarks/keep_results.py NAME=DIR` puts them here, writes this text and draws the pictures of
the documentation. `topo_search/experiments/conducting.py` explains the columns. In Python, with a picture of the
rows that are here:

```python
from topo_search.experiments import experiment, results

asked, rows = experiment("ablation"), results("notebooks/results/ablation.csv")
print(asked.summary(rows))
asked.figure(rows).savefig("ablation.png")
```

Shares and efforts are those that these few starts reach: more trees may have a design, and a stricter problem can
come out cheaper where its starts were luckier. Seconds are CPU seconds of one thread on a machine that did other
work at the same time, which slows caches and memory; the documentation's page on benchmarks has times of a machine
at rest. Rows of `wall-push` are of `tests/designs/wall-push.toml`, with reserves at the tip.
"""


def main() -> None:
    """Keep the runs that are named, and write the text."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", nargs="*", metavar="NAME=FOLDER", help="name of the file, folder of the run")
    for run in parser.parse_args().runs:
        name, _, folder = run.partition("=")
        keep(name, Path(folder))
    (KEPT / "README.md").write_text(HEAD + "".join(map(section, NAMES)), encoding="utf-8")
    for name in SHOWN:
        experiment(name).figure(kept(name)).savefig(KEPT.parent / "pictures" / f"{name}.png", dpi=110)


def keep(name: str, folder: Path) -> None:
    """Copy the whole rows of a run, and its description."""
    rows = (folder / "results.csv").read_bytes()
    (KEPT / f"{name}.csv").write_bytes(rows[: rows.rfind(b"\n") + 1])
    (KEPT / f"{name}.json").write_bytes((folder / "about.json").read_bytes())


def settings_of(value: dict[str, Any]) -> Settings:
    """Return the settings that a JSON value of `Settings.as_json` holds."""
    tasks = tuple((name, tuple(sizes)) for name, sizes in value["tasks"].items())
    few, fewer = value["topologies"]
    return Settings(**{**value, "tasks": tasks, "topologies": (few, fewer), "distances": tuple(value["distances"])})


def section(name: str) -> str:
    """Return what the rows of an experiment show, those of other methods beside them."""
    asked = experiment(name)
    parts = [f"\n## {asked.question}\n"]
    for table in tables(name):
        rows = results(table)
        about = json.loads(table.with_suffix(".json").read_text(encoding="utf-8"))
        planned = len(asked.cells(settings_of(about["settings"])))
        parts.append(f"\n`{table.name}`, {len(rows)} of {planned} problems of\n\n    {about['command']}\n")
    parts += ["\n", *(f"{bullet(finding)}\n" for finding in asked.findings(kept(name)))]
    return "".join(parts)


def tables(name: str) -> list[Path]:
    """Return the tables of an experiment, the solver's first."""
    return sorted(KEPT.glob(f"{name}*.csv"), key=lambda path: path.stem)


def kept(name: str) -> pd.DataFrame:
    """Return the rows of all methods."""
    return pd.concat([results(table) for table in tables(name)], ignore_index=True)


def bullet(text: str) -> str:
    """Return a text as a point of a list, no number or word broken."""
    return textwrap.fill(
        text, 116, initial_indent="- ", subsequent_indent="  ", break_on_hyphens=False, break_long_words=False
    )


if __name__ == "__main__":
    main()
