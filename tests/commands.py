"""Commands in this process: every test of one states the exit status that it ends with."""

from click.testing import CliRunner, Result

from topo_search.cli import main


def invoke(*words: object, status: int = 0) -> Result:
    """Run a command; what goes wrong in it is raised here."""
    result = CliRunner().invoke(main, list(map(str, words)), catch_exceptions=False)
    assert result.exit_code == status, result.output
    return result


def refused(*words: object) -> str:
    """Run a command that is wrong, and return what it says in place of an answer, as one line."""
    result = invoke(*words, status=2)
    assert result.stdout == ""
    return " ".join(result.stderr.split())
