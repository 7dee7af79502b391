"""Command line: one file a verb. Heavy imports wait until a verb runs, so that `--help` answers at once."""

from icjax.cli._main import main as main
