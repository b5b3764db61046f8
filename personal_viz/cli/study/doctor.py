"""Verb `study doctor`: checks a public deployment from outside."""

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import arg

from personal_viz.study_app.operator.doctor import Check, examine

from ..output import print_json


@dataclass
class StudyDoctor:
    """Check a deployment from outside: TLS, websocket, Origin, Host, cookies, clock, bandwidth."""

    url: str
    link: Annotated[str | None, arg(help="A personal link, to try the whole way in.")] = None
    insecure_ca: Annotated[Path | None, arg(help="Certificate to trust besides the system's (PEM).")] = None
    http_port: Annotated[int | None, arg(help="Where plain http is expected to lead to https; 80 by default.")] = None
    json: bool = False

    def run(self) -> int:
        checks = examine(self.url, link=self.link, insecure_ca=self.insecure_ca, http_port=self.http_port)
        if self.json:
            print_json([dataclasses.asdict(check) for check in checks])
        else:
            for check in checks:
                print(_line(check))
        failed = [check.name for check in checks if check.passed is False]
        if not self.json:
            print(
                f"{self.url}: " + (f"{len(failed)} of {len(checks)} checks failed" if failed else "nothing to correct")
            )
        return 1 if failed else 0


def _line(check: Check) -> str:
    mark = {True: "pass", False: "FAIL", None: "-   "}[check.passed]
    line = f"{mark}  {check.name}: {check.detail}"
    return f"{line}. {check.advice}" if check.passed is False and check.advice else line
