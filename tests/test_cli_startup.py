import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from documented import PAGES

from topo_search.cli import main

HEAVY = [
    *("casadi", "nlp", "verify", "fcl", "optuna", "pandas", "rich"),
    *("pebble", "plotly", "trimesh", "topo_search.compose"),
]


def loaded_after(statement, names):
    """Which of some modules a fresh interpreter has loaded after a statement."""
    code = f"import sys\n{statement}\nprint([name for name in {names!r} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stdout.splitlines()[-1]


@pytest.mark.parametrize(
    ("statement", "names"),
    [
        ("import topo_search", [*HEAVY, "pydantic", "numpy", "topo_search.model"]),
        ("import topo_search.model", HEAVY),
        ("import verify", ["casadi", "nlp", "optuna", "pandas", "numpy"]),
        ("from verify import audit", ["casadi", "nlp", "optuna", "pandas", "pebble"]),
        ("import topo_search.cli", [*HEAVY, "pydantic", "numpy", "topo_search.model"]),
        (
            "import topo_search.compose",
            [
                "cloudpickle",
                "manifold3d",
                "networkx",
                "numba",
                "optuna",
                "pandas",
                "pebble",
                "scipy.spatial",
                "trimesh",
            ],
        ),
        ("import topo_search.report.run_page", ["manifold3d", "networkx", "trimesh"]),
    ],
)
def test_what_is_not_needed_is_not_loaded(statement, names):
    assert loaded_after(statement, names) == "[]"


HELP = """
import sys
from topo_search.cli import main
for command in COMMANDS:
    try:
        main([*command.split(), "--help"])
    except SystemExit as end:
        assert end.code == 0
    print("loaded after", command, {name for name in NAMES if name in sys.modules})
"""


def test_help_loads_nothing_heavy_and_has_an_example():
    commands = ["", *main.commands]
    names = [*HEAVY, "pydantic", "numpy", "topo_search.model", "matplotlib", "pyarrow"]
    code = HELP.replace("COMMANDS", repr(commands)).replace("NAMES", repr(names))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    told = re.split(r"^loaded after (.*)$", done.stdout, flags=re.MULTILINE)
    assert told[1::2] == [f"{command} set()" for command in commands]
    assert all("Example: topo-search" in text for text in told[:-1:2])


def test_public_names_are_no_modules_even_after_those_are_loaded():
    statement = "import topo_search, topo_search.compose, topo_search.engine, topo_search.study"
    code = f"{statement}\nprint({{type(getattr(topo_search, name)) for name in topo_search.__all__}})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "module" not in done.stdout


def test_commands_compute_in_one_thread():
    """Threads of a library for linear algebra take longer than one, and change sums."""
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")
    shown = f"print([os.environ[name] for name in {names}], 'numpy' in sys.modules)"
    code = f"import os, sys\nfrom topo_search.supervisor import supervise\nsupervise(lambda: {shown})"
    environment = {name: value for name, value in os.environ.items() if name not in names}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment)
    assert done.stdout.splitlines()[-1] == "['1', '1'] False"


# ---- Shell completion as the installation page shows it: the scripts exist, and Tab completes commands and
# choices.

COMMAND = str(Path(sys.executable).with_name("topo-search"))


def asked(**variables: str) -> str:
    environment = {**os.environ, **variables}
    return subprocess.run([COMMAND], env=environment, capture_output=True, text=True, check=True).stdout


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_documented_script_is_printed(shell):
    if shell == "bash" and shutil.which("bash") is None:
        pytest.skip("click asks bash for its version")
    shown = (PAGES / "installation.md").read_text(encoding="utf-8")
    (variable,) = re.findall(rf"(_\w+)={shell}_source", shown)
    assert f"{variable}={shell}_complete" in asked(**{variable: f"{shell}_source"})


@pytest.mark.parametrize(
    ("words", "word", "offered"),
    [
        ("topo-search ", "1", "audit"),
        ("topo-search run push --sampler n", "4", "nsga2"),
        ("topo-search run --pa", "2", "--paper"),
    ],
)
def test_tab_completes_commands_options_and_choices(words, word, offered):
    told = asked(_TOPO_SEARCH_COMPLETE="bash_complete", COMP_WORDS=words, COMP_CWORD=word)
    assert f"plain,{offered}" in told.splitlines()
