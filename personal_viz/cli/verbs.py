"""The command line: one dataclass per verb, parsed by tyro; each worker is imported only after parsing."""

from typing import Annotated

import tyro
from tyro.conf import subcommand

from .browse import Browse
from .compare import Compare
from .export import Export
from .options_ground import Ground
from .options_grounding import Explore, Map, PogReport, ShowExploration, ShowMap
from .options_homes import ContactSheet, Homes, Invent, Stats, Validate
from .options_runs import Bench, CheckHabitat, Import, Metrics, Run
from .replay import Replay
from .study.options_study import Demo, Study

Verb = (
    Annotated[Demo, subcommand("demo")]
    | Annotated[Validate, subcommand("validate")]
    | Annotated[Stats, subcommand("stats")]
    | Annotated[Invent, subcommand("invent")]
    | Annotated[Homes, subcommand("homes")]
    | Annotated[ContactSheet, subcommand("contact-sheet")]
    | Annotated[Run, subcommand("run")]
    | Annotated[Explore, subcommand("explore")]
    | Annotated[Ground, subcommand("ground")]
    | Annotated[PogReport, subcommand("pog-report")]
    | Annotated[ShowExploration, subcommand("show-exploration")]
    | Annotated[ShowMap, subcommand("show-map")]
    | Annotated[Map, subcommand("map")]
    | Annotated[Import, subcommand("import")]
    | Annotated[Metrics, subcommand("metrics")]
    | Annotated[Replay, subcommand("replay")]
    | Annotated[Compare, subcommand("compare")]
    | Annotated[Browse, subcommand("browse")]
    | Annotated[Export, subcommand("export")]
    | Annotated[Study, subcommand("study")]
    | Annotated[CheckHabitat, subcommand("check-habitat")]
    | Annotated[Bench, subcommand("bench")]
)


def parse(arguments: list[str] | None = None) -> Verb:
    """The verb that the command line names.

    Raises:
        SystemExit: Usage error (2) or --help (0).
    """
    return tyro.cli(
        Verb,  # type: ignore[arg-type]
        prog="personal-viz",
        description="3-D visualization and human baselines for the PersONAL benchmark.",
        args=arguments,
        config=(tyro.conf.OmitArgPrefixes, tyro.conf.OmitSubcommandPrefixes),
    )
