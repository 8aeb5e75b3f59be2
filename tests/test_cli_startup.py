import os
import subprocess
import sys

import pytest

HEAVY = [
    "casadi",
    "nlp",
    "verify",
    "fcl",
    "optuna",
    "pandas",
    "rich",
    "pebble",
    "plotly",
    "trimesh",
    "topo_search.compose",
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
        ("import verify", ["casadi", "nlp", "optuna", "pandas"]),
        ("from verify import audit", ["casadi", "nlp", "optuna", "pandas", "pebble"]),
        ("import topo_search.cli", [*HEAVY, "pydantic", "numpy", "topo_search.model"]),
    ],
)
def test_what_is_not_needed_is_not_loaded(statement, names):
    assert loaded_after(statement, names) == "[]"


@pytest.mark.parametrize(
    "command",
    [
        [],
        ["run"],
        ["solve"],
        ["audit"],
        ["topologies"],
        ["report"],
        ["experiment"],
        ["examples"],
        ["init"],
        ["check"],
    ],
)
def test_help_loads_nothing_heavy_and_has_an_example(command):
    statement = (
        "from topo_search.cli import main\n"
        f"try:\n    main([*{command!r}, '--help'])\nexcept SystemExit as end:\n    assert end.code == 0"
    )
    names = [*HEAVY, "pydantic", "numpy", "topo_search.model"]
    code = f"import sys\n{statement}\nprint([name for name in {names!r} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[]"
    assert "Example: topo-search" in done.stdout


def test_the_package_is_the_command_too():
    done = subprocess.run(
        [sys.executable, "-m", "topo_search", "examples"], capture_output=True, text=True, check=True
    )
    assert "push" in done.stdout.splitlines()


def test_public_names_are_functions_even_after_their_modules_are_loaded():
    statement = "import topo_search, topo_search.compose, topo_search.engine, topo_search.study"
    code = f"{statement}\nprint(all(callable(getattr(topo_search, name)) for name in topo_search.__all__))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "True"


def test_commands_compute_in_one_thread():
    """Threads of a library for linear algebra take longer than one, and change sums."""
    statement = (
        "import contextlib, os, sys; sys.argv[1:] = ['--version']; from topo_search.__main__ import _command"
    )
    run = "with contextlib.suppress(SystemExit): _command()"
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS")
    code = f"{statement}\n{run}\nprint([os.environ[name] for name in {names}], 'numpy' in sys.modules)"
    environment = {name: value for name, value in os.environ.items() if name not in names}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True, env=environment)
    assert done.stdout.splitlines()[-1] == "['1', '1'] False"
