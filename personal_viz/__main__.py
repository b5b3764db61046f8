"""Entry point of `personal-viz`: known errors are one line and exit code 1, usage errors 2, bugs a traceback.

Output whose reader has gone (`| head`) ends the program in silence with exit code 141, as it ends other programs.
"""

import os
import select
import sys

from pydantic import ValidationError

from sim.errors import PersonalVizError

from .cli.verbs import parse
from .printed import one_line, printable_streams

READER_GONE = 141
"""What a shell reports of a program that SIGPIPE ended: 128 + 13."""


def main() -> None:
    """Parses, works, exits."""
    code: int | str | None = 0
    try:
        code = work()
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


def work() -> int:
    """Does what the command line says.

    Returns:
        The exit code.
    """
    verb = parse()
    with printable_streams():
        try:
            return verb.work()
        except PersonalVizError as error:
            line = str(error)
        except ValidationError as error:
            from .study_app.checked_options import line_from_refused_options

            line = line_from_refused_options(type(verb).__name__.lower(), vars(getattr(verb, "verb", verb)), error)
        except KeyboardInterrupt:
            print("personal-viz: stopped", file=sys.stderr)
            return 130
        print(f"personal-viz: {one_line(line)}", file=sys.stderr)  # one line, whatever a plug-in raised
        return 1


def has_lost_reader() -> bool:
    """Whether standard output or standard error is a pipe that nobody reads any more."""
    if not hasattr(select, "poll"):  # Windows has other errors
        return False
    ends = select.poll()
    for stream in (sys.stdout, sys.stderr):
        try:
            ends.register(stream.fileno(), 0)  # errors are told unasked
        except (OSError, ValueError, AttributeError):  # not a file, closed, or none (pythonw)
            continue
    return any(event & select.POLLERR for _, event in ends.poll(0))


def discard_output() -> None:
    """Lets what a lost reader did not take go nowhere, so that Python's last flush does not fail."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except BrokenPipeError:
            os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


if __name__ == "__main__":
    main()
