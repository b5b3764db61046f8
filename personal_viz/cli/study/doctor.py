"""Verb `study doctor`: checks a public deployment from outside."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import arg

from personal_viz.study_app.operator.doctor import examine

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
        found = examine(self.url, link=self.link, insecure_ca=self.insecure_ca, http_port=self.http_port)
        failed = [name for name, finding in found.items() if finding.passed is False]
        if self.json:
            print_json([{"name": name, **finding._asdict()} for name, finding in found.items()])
            return 1 if failed else 0
        for name, finding in found.items():
            mark = {True: "pass", False: "FAIL", None: "-   "}[finding.passed]
            advice = f". {finding.advice}" if finding.passed is False and finding.advice else ""
            print(f"{mark}  {name}: {finding.detail}{advice}")
        print(f"{self.url}: " + (f"{len(failed)} of {len(found)} checks failed" if failed else "nothing to correct"))
        return 1 if failed else 0
