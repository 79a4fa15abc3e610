"""Verbs that need no process of their own run in this one, which has loaded them once."""

from pathlib import Path

from click.testing import CliRunner

from trunk_experiments.cli import trunk


def said(*arguments: object, code: int = 0) -> str:
    """Return what ``trunk`` with these arguments prints. Files are named with their folder.

    Fails the test if the exit code is another.
    """
    result = CliRunner().invoke(trunk, [str(argument) for argument in arguments])
    assert result.exit_code == code, result.output
    return result.output


def verified(path: Path) -> str:
    """Return what ``trunk verify`` prints of a recording, which must be verified."""
    text = said("verify", path)
    assert ": verified" in text
    return text
