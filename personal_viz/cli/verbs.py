"""The command line: one dataclass per verb, parsed by tyro; heavy modules are imported only when a verb runs."""

from dataclasses import replace
from types import NoneType, UnionType
from typing import Union, get_args

import tyro
from tyro.constructors import ConstructorRegistry, PrimitiveConstructorSpec, PrimitiveTypeInfo

from .bench import Bench
from .browse import Browse
from .check_habitat import CheckHabitat
from .compare import Compare
from .contact_sheet import ContactSheet
from .demo import Demo
from .export import Export
from .grounding.explore import Explore
from .grounding.ground import Ground
from .grounding.map import Map
from .grounding.pog_report import PogReport
from .grounding.show_exploration import ShowExploration
from .grounding.show_map import ShowMap
from .homes import Homes
from .import_runs import Import
from .invent import Invent
from .metrics import Metrics
from .replay import Replay
from .run import Run
from .stats import Stats
from .study.verbs import Study
from .validate import Validate

Verb = (
    Demo
    | Validate
    | Stats
    | Invent
    | Homes
    | ContactSheet
    | Run
    | Explore
    | Ground
    | PogReport
    | ShowExploration
    | ShowMap
    | Map
    | Import
    | Metrics
    | Replay
    | Compare
    | Browse
    | Export
    | Study
    | CheckHabitat
    | Bench
)
"""All verbs, in the order of the help; each is named after its class, as `contact-sheet` after `ContactSheet`."""


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
        registry=_registry(),
    )


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
