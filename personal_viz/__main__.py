"""Entry point of `personal-viz`: known errors are one line and exit code 1, usage errors 2, bugs a traceback."""

import sys

from sim.errors import PersonalVizError

from .cli import parse


def main() -> None:
    """Parses, works, exits."""
    verb = parse()
    try:
        code = verb.work()
    except PersonalVizError as error:
        print(f"personal-viz: {' '.join(str(error).split())}", file=sys.stderr)  # one line, whatever a plug-in raised
        code = 1
    except KeyboardInterrupt:
        print("personal-viz: stopped", file=sys.stderr)
        code = 130
    sys.exit(code)


if __name__ == "__main__":
    main()
