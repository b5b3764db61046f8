"""Entry point of `personal-viz`: known errors are one line and exit code 1, usage errors 2, bugs a traceback.

When the reader of its output has gone (`| head`), the program ends silently with exit code 141, as other programs do.
"""

import os
import select
import sys
import warnings
from typing import TextIO

from sim.errors import PersonalVizError

from .cli.verbs import parse

READER_GONE = 141
"""The exit code that a shell reports for a program ended by SIGPIPE: 128 + 13."""


def main() -> None:
    """Runs the command line and exits with its code."""
    code: int | str | None = 0
    warnings.showwarning = show_warning
    try:
        code = run()
        sys.stdout.flush()
    except SystemExit as end:  # --help, a usage error, or rich, which ends the program when its reader has gone
        code = end.code
    except BrokenPipeError:
        if not has_lost_reader():  # another pipe or socket: a bug
            raise
    if has_lost_reader():
        code = READER_GONE
        discard_output()
    sys.exit(code)


def run() -> int:
    """Carries out the command line.

    Returns:
        The exit code.
    """
    verb = parse()
    from pydantic import ValidationError  # --help needs neither pydantic nor rich

    from .printed import one_line, printable_streams

    with printable_streams():
        try:
            return verb.run()
        except PersonalVizError as error:
            line = str(error)
        except ValidationError as error:
            from .cli.refusals import line_from_refused_options

            line = line_from_refused_options(type(verb).__name__.lower(), vars(verb), error)
        except KeyboardInterrupt:
            print("personal-viz: stopped", file=sys.stderr)
            return 130
        print(f"personal-viz: {one_line(line)}", file=sys.stderr)  # one line, whatever a plug-in raised
        return 1


def show_warning(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    """Prints a warning for users as one line; other warnings keep their place in the code."""
    if category is UserWarning:
        print(f"personal-viz: {message}", file=file or sys.stderr)
    else:
        print(warnings.formatwarning(message, category, filename, lineno, line), end="", file=file or sys.stderr)


def has_lost_reader() -> bool:
    """Whether standard output or standard error is a pipe that nobody reads any more."""
    if not hasattr(select, "poll"):  # Windows has other errors
        return False
    ends = select.poll()
    for stream in (sys.stdout, sys.stderr):
        try:
            ends.register(stream.fileno(), 0)  # errors are reported without asking for them
        except (OSError, ValueError, AttributeError):  # not a file, closed, or none (pythonw)
            continue
    return any(event & select.POLLERR for _, event in ends.poll(0))


def discard_output() -> None:
    """Discards output that a lost reader did not take, so that Python's last flush does not fail."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except BrokenPipeError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


if __name__ == "__main__":
    main()
