"""Options that several verbs share, checked before any work is done."""

import re
from collections.abc import Mapping

from pydantic import ValidationError

from sim.errors import PersonalVizError, line_from_validation_error
from sim.tasks.run_files import RUN_ID
from sim.types import SceneKind


def check_options(
    *, run_id: str | None, limit: int | None = None, jobs: int = 1, seed: int = 0, sample_seed: int = 0
) -> None:
    """Refuses what no run can be made with.

    Args:
        run_id: `--run-id`; None = the verb's own name for the folder.
        limit: `--limit`; None = all episodes.
        jobs: `--jobs`.
        seed: `--seed`.
        sample_seed: `--sample-seed`.

    Raises:
        PersonalVizError: Names the option, what was found and what was expected.
    """
    least_values = (("--limit", limit, 1), ("--jobs", jobs, 1), ("--seed", seed, 0), ("--sample-seed", sample_seed, 0))
    for option, value, least in least_values:
        if value is not None and value < least:
            raise PersonalVizError(
                f"{option} is {value}; expected a whole number from {least}. Leave it out for the default."
            )
    if run_id is not None and not re.fullmatch(RUN_ID, run_id):
        raise PersonalVizError(
            f"--run-id is {run_id!r}; expected 1 to 80 letters, digits, '.', '_' or '-', not starting with '.'. "
            "Give another, or leave it out; --out says in which folder."
        )


def line_from_refused_options(verb: str, options: Mapping[str, object], error: ValidationError) -> str:
    """One line for a value that no file or run may hold, with the option that it came from.

    Args:
        verb: As the command line names it, for values that were made from several options.
        options: Values by field name of the verb.
        error: What pydantic raised.
    """
    first = error.errors()[0]
    same_name = [name for name in options if name == (first["loc"] or ("",))[-1]]
    same_value = [name for name, value in options.items() if value is not None and str(value) == str(first["input"])]
    both = [name for name in same_name if name in same_value]
    for name in (
        *both,
        *same_value,
        *same_name,
    ):  # a field may be called as another option: the study's name, its folder
        option = f"--{name.replace('_', '-')}"
        return line_from_validation_error(option, error, advice=f"Give another {option}.")
    advice = "Change the options; where they are as they should be, please report this line with your command."
    return line_from_validation_error(f"{verb}, {error.title}", error, advice=advice)


def require_no_scan(kind: SceneKind, *, clutter: int) -> None:
    """Refuses clutter in scans, which have their own.

    Args:
        kind: Of the homes that are opened.
        clutter: `--clutter`.

    Raises:
        PersonalVizError: Both are asked for.
    """
    if clutter and kind == "scan":
        raise PersonalVizError(
            f"--clutter is {clutter} beside --scenes-dir; expected 0 in scans. Leave one of the two out."
        )
