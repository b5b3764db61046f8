"""The command line: one dataclass per verb, parsed by tyro. Only the module of the verb that is typed is imported."""

import ast
import re
import sys
from collections.abc import Sequence
from dataclasses import make_dataclass, replace
from importlib import import_module
from pathlib import Path
from types import NoneType, UnionType
from typing import Protocol, Union, get_args

import tyro
from tyro.constructors import ConstructorRegistry, PrimitiveConstructorSpec, PrimitiveTypeInfo
from tyro.extras import subcommand_cli_from_dict

PROGRAM = "personal-viz"
STUDY = "study"
"""First word of the verbs of studies with people."""
STUDIES = "Studies with people."
VERBS = {
    "demo": "demo.Demo",
    "validate": "validate.Validate",
    "stats": "stats.Stats",
    "invent": "invent.Invent",
    "annotate": "scans.annotate.Annotate",
    "generate": "scans.generate.Generate",
    "check-scans": "scans.check_scans.CheckScans",
    "reproduce": "scans.reproduce.Reproduce",
    "homes": "homes.Homes",
    "contact-sheet": "contact_sheet.ContactSheet",
    "run": "runs.run.Run",
    "explore": "grounding.explore.Explore",
    "ground": "grounding.ground.Ground",
    "pog-report": "grounding.pog_report.PogReport",
    "show-exploration": "grounding.show_exploration.ShowExploration",
    "show-map": "grounding.show_map.ShowMap",
    "map": "grounding.map.Map",
    "ask": "grounding.ask.Ask",
    "import": "runs.import_runs.Import",
    "merge": "runs.merge.Merge",
    "metrics": "runs.metrics.Metrics",
    "replay": "runs.replay.Replay",
    "compare": "runs.compare.Compare",
    "browse": "browse.Browse",
    "view": "scans.view.View",
    "export": "runs.export.Export",
    "study init": "study.init.StudyInit",
    "study plan": "study.plan.StudyPlanVerb",
    "study ethics": "study.ethics.StudyEthics",
    "study serve": "study.serve.StudyServe",
    "study status": "study.status.StudyStatus",
    "study doctor": "study.doctor.StudyDoctor",
    "study bots": "study.bots.StudyBots",
    "study withdraw": "study.withdraw.StudyWithdraw",
    "study purge-ids": "study.purge_ids.StudyPurgeIds",
    "study exclude": "study.exclude.StudyExclude",
    "study check-db": "study.check_db.StudyCheckDb",
    "study verify": "study.verify.StudyVerify",
    "study export": "study.export.StudyExport",
    "study import-check": "study.import_check.StudyImportCheck",
    "study report": "study.report.StudyReportVerb",
    "check-habitat": "check_habitat.CheckHabitat",
    "bench": "bench.Bench",
}
"""Module and dataclass of each verb, in the order of the help."""


class Verb(Protocol):
    """The options of a verb, and its work."""

    def run(self) -> int:
        """Does the work and returns the exit code."""
        ...


def parse(arguments: Sequence[str] | None = None) -> Verb:
    """The verb that the command line names, with its options.

    Raises:
        SystemExit: Usage error (2) or --help (0).
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    num_named = 2 if words[:1] == [STUDY] else 1
    name, options = " ".join(words[:num_named]), _with_directions(words[num_named:])
    if name not in VERBS:
        _list_verbs(words)
    module, _, kind = VERBS[name].rpartition(".")
    return tyro.cli(
        getattr(import_module(f".{module}", __package__), kind),
        prog=f"{PROGRAM} {name}",
        args=options,
        config=(tyro.conf.OmitArgPrefixes,),
        registry=_registry(),
    )


def _with_directions(options: Sequence[str]) -> list[str]:
    """The options, in which a direction after `--up` that begins with a minus is its value, not an option."""
    joined: list[str] = []
    for word in options:
        if joined and joined[-1] == "--up" and re.match(r"-[xyz.\d]", word):
            joined[-1] = f"--up={word}"
        else:
            joined.append(word)
    return joined


def _list_verbs(words: list[str]) -> None:
    """Ends the program with the help of all verbs, or of those below `study`, or with a usage error."""
    is_below = words[:1] == [STUDY]
    start = f"{STUDY} " if is_below else ""
    names = {name.removeprefix(start).split()[0]: name for name in VERBS if name.startswith(start)}
    helps = {word: STUDIES if word == STUDY else _help_of(name) for word, name in names.items()}
    subcommand_cli_from_dict(
        {word: make_dataclass("Verb", (), namespace={"__doc__": text}) for word, text in helps.items()},
        prog=f"{PROGRAM} {STUDY}" if is_below else PROGRAM,
        description=STUDIES if is_below else "3-D visualization and human baselines for the PersONAL benchmark.",
        args=words[1:] if is_below else words,
    )


def _help_of(name: str) -> str | None:
    """The docstring of a verb's dataclass; its module, which may take a second to import, is only read."""
    module, _, kind = VERBS[name].rpartition(".")
    source = Path(__file__).parent.joinpath(*module.split(".")).with_suffix(".py").read_text(encoding="utf-8")
    (verb,) = (node for node in ast.parse(source).body if isinstance(node, ast.ClassDef) and node.name == kind)
    return ast.get_docstring(verb)


def _registry() -> ConstructorRegistry:
    """Makes tyro read `X | None` as X: nobody types None, so help need not show it; an option left out stays None."""
    registry = ConstructorRegistry()

    @registry.primitive_rule
    def without_none(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec | None:
        inner = [part for part in get_args(info.type) if part is not NoneType]
        if info.type_origin not in (Union, UnionType) or len(inner) != 1 or len(get_args(info.type)) != 2:
            return None
        spec = ConstructorRegistry.get_primitive_spec(PrimitiveTypeInfo.make(inner[0], info.markers))
        if not isinstance(spec, PrimitiveConstructorSpec):
            return None
        return replace(
            spec,
            is_instance=lambda value: value is None or spec.is_instance(value),
            str_from_instance=lambda value: ["none"] if value is None else spec.str_from_instance(value),
        )

    return registry
