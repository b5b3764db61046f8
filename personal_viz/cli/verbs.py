"""The command line: one dataclass per verb, parsed by tyro. Only the module of the verb that is typed is imported."""

import ast
import re
import sys
from collections.abc import Collection, Mapping, Sequence
from dataclasses import is_dataclass, make_dataclass, replace
from importlib import import_module
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Protocol, Union, get_args, get_origin, get_type_hints

import tyro
from tyro.conf import Positional
from tyro.constructors import ConstructorRegistry, PrimitiveConstructorSpec, PrimitiveTypeInfo
from tyro.extras import subcommand_cli_from_dict

from sim.errors import did_you_mean

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


_POSITIONAL = get_args(Positional[int])[1:]
"""The mark of positional arguments."""


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
    _require_known(name, options, options_of(name))
    return tyro.cli(
        _verb(name),
        prog=f"{PROGRAM} {name}",
        args=options,
        config=(tyro.conf.OmitArgPrefixes,),
        registry=_registry(),
    )


def options_of(name: str) -> dict[str, Any]:
    """The options of a verb with their types; under "" the type of its first positional argument."""
    return _options_of(_verb(name))


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
    for word in words[1:2] if is_below else words[:1]:
        below = f" Did you mean '{STUDY} {word}'?" if f"{STUDY} {word}" in VERBS else ""
        _refuse_alike(f"{PROGRAM} {start}".strip(), word, {*names, "--help"}, "command", below)
    helps = {word: STUDIES if word == STUDY else _help_of(name) for word, name in names.items()}
    subcommand_cli_from_dict(
        {word: make_dataclass("Verb", (), namespace={"__doc__": text}) for word, text in helps.items()},
        prog=f"{PROGRAM} {STUDY}" if is_below else PROGRAM,
        description=STUDIES if is_below else "3-D visualization and human baselines for the PersONAL benchmark.",
        args=words[1:] if is_below else words,
    )


def _refuse_alike(where: str, word: str, known: Collection[str], kind: str, meant: str = "") -> None:
    """Ends the program with a usage error of one line if a word is none of the known ones, but like one of them."""
    meant = "" if word in known else meant or did_you_mean(word, known)
    if meant:
        print(f"{where}: found {word!r}, which is no {kind}.{meant} See {where} --help.", file=sys.stderr)
        sys.exit(2)


def _require_known(name: str, words: Sequence[str], options: Mapping[str, type]) -> None:
    """Ends the program if a word is like an option of the verb, or like a value of the closed set that is due."""
    where = f"{PROGRAM} {name}"
    due, has_several = "", False
    for word in words:
        option, _, value = word.partition("=")
        if option.startswith("--"):
            due = option.replace("_", "-")
            _refuse_alike(where, due, {*options, "--help"}, "option")
            has_several = get_origin(options.get(due)) is tuple
            word = value
        if word and (values := _closed_set(options.get(due))):
            _refuse_alike(where, word, values, f"value of {due}" if due else "value here")
        if word and not has_several:
            due = ""


def _verb(name: str) -> type:
    """The dataclass of a verb."""
    module, _, kind = VERBS[name].rpartition(".")
    return getattr(import_module(f".{module}", __package__), kind)


def _options_of(verb: Any) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for field, hint in get_type_hints(verb, include_extras=True).items():
        kind, *notes = get_args(hint) if get_origin(hint) is Annotated else (hint,)
        if is_dataclass(kind):
            found = _options_of(kind) | found
        elif any(note in _POSITIONAL for note in notes):
            found.setdefault("", kind)
        else:
            names = [name for note in notes if (name := getattr(note, "name", None))] or [field]
            names += [alias for note in notes for alias in getattr(note, "aliases", None) or ()]
            for option in (name.lstrip("-").replace("_", "-") for name in names):
                found |= {f"--{option}": kind} | ({f"--no-{option}": None} if kind is bool else {})
    return found


def _closed_set(kind: Any) -> set[str]:
    """The values of a type that allows no others, also none or several of them; empty for other types."""
    if get_origin(kind) is Literal:
        return set(map(str, get_args(kind)))
    if get_origin(kind) not in (tuple, Annotated, Union, UnionType):
        return set()
    parts = [_closed_set(part) for part in get_args(kind) if part not in (NoneType, ...)]
    return set().union(*parts) if all(parts) else set()


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
