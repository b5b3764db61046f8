"""`personal-viz` as a person calls it, without a process of its own: its imports cost more than most commands."""

import contextlib
import io
import os
import sys
from dataclasses import dataclass
from unittest import mock

from personal_viz.__main__ import main


@dataclass(frozen=True)
class Done:
    """A finished command."""

    returncode: int
    stdout: str
    stderr: str


def personal_viz(*arguments: object, **environment: str) -> Done:
    """The program's output and exit code, without the output of its child processes."""
    code: object = None
    with (
        mock.patch.object(sys, "argv", ["personal-viz", *map(str, arguments)]),
        mock.patch.dict(os.environ, environment),
        contextlib.redirect_stdout(io.StringIO()) as stdout,
        contextlib.redirect_stderr(io.StringIO()) as stderr,
    ):
        try:
            main()
        except SystemExit as ended:
            code = ended.code
    assert isinstance(code, int)
    return Done(code, stdout.getvalue(), stderr.getvalue())


def assert_one_line(done: Done, *parts: str) -> None:
    """Exit code 1 and one line on standard error that holds the parts."""
    assert done.returncode == 1, done.stderr
    assert len(done.stderr.strip().splitlines()) == 1, done.stderr
    for part in parts:
        assert part in done.stderr
