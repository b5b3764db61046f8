"""Verb `study doctor`: looks at a public deployment from outside."""

import dataclasses
import json as json_format
from pathlib import Path

from personal_viz.study_app.operator.doctor import examine
from personal_viz.study_app.operator.doctor_site import Check


def doctor(
    *,
    url: str,
    json: bool = False,
    insecure_ca: Path | None = None,
    link: str | None = None,
    http_port: int | None = None,
) -> int:
    """Prints one line per check; exit code 1 when one fails.

    Args:
        url: What participants open, without a token.
        json: Print one JSON array instead, for other programs.
        insecure_ca: Certificates to trust besides the system's.
        link: A personal link with which to take part for a moment.
        http_port: Where plain HTTP is answered, when the address has a port of its own.
    """
    checks = examine(url, link=link, insecure_ca=insecure_ca, http_port=http_port)
    if json:
        print(json_format.dumps([dataclasses.asdict(check) for check in checks], indent=1))
    else:
        for check in checks:
            print(_line(check))
    failed = [check.name for check in checks if check.passed is False]
    if not json:
        print(f"{url}: " + (f"{len(failed)} of {len(checks)} checks failed" if failed else "nothing to correct"))
    return 1 if failed else 0


def _line(check: Check) -> str:
    mark = {True: "pass", False: "FAIL", None: "-   "}[check.passed]
    line = f"{mark}  {check.name}: {check.detail}"
    return f"{line}. {check.advice}" if check.passed is False and check.advice else line
