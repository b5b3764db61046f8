"""The agents that `run --agent` knows by name, with the options that belong to each."""

from collections.abc import Mapping
from dataclasses import dataclass, field

from grounding.agents.by_name import SEEING, MakesSeeing, SeeingName, looks_of
from grounding.agents.goal_text import GoalText
from grounding.chat.endpoint import LlmOptions
from grounding.encoders.by_name import require_no_model_options
from grounding.encoders.protocol import ModelOptions
from grounding.perception.by_name import is_oracle, own_parts, perception_called
from sim.errors import AgentError, did_you_mean
from sim.plugins import is_plugin, own_name, plugin_digest
from sim.tasks.agent_makers import AgentMaker, MakesPlugin, MakesRandom, MakesShortestPath
from sim.tasks.agents import load_agent
from sim.tasks.looks import LookKind, LooksFirst
from sim.types import SuccessRule

RANDOM_FRONTIER = MakesPlugin("grounding.agents.random_frontier:random_frontier")
"""Our agent `random-frontier`, which the simulator loads as it loads a user's."""


@dataclass(frozen=True, slots=True)
class AgentOptions:
    """The options of `run` that belong to some agents only."""

    rule: SuccessRule | None = None
    perception: str | None = None
    goal_text: GoalText = "phrase"
    model: ModelOptions = field(default_factory=ModelOptions)
    llm: LlmOptions | None = None


@dataclass(frozen=True, slots=True)
class NamedAgent:
    """An agent, and what a run's file says about it."""

    maker: AgentMaker
    who: str
    """Row name in tables."""
    made_for: SuccessRule | None = None
    """The success rule of an agent with ground truth."""
    condition: str = ""
    """What it sees with and looks for, in words for rows of tables; empty for agents without perception."""
    config: dict[str, str] = field(default_factory=dict)
    looks: frozenset[LookKind] = frozenset()
    """The looks at a home that it can take before the task."""


def named_agent(name: str, options: AgentOptions, *, seed: int) -> NamedAgent:
    """The agent of this name.

    Raises:
        AgentError: No agent has this name, a user's own cannot be built, or an option is missing or does not belong to
            it.
    """
    _require_fitting(name, options)
    match name:
        case "random":
            return NamedAgent(MakesRandom(), name)
        case "random-frontier":
            return NamedAgent(RANDOM_FRONTIER, name)
        case "shortest-path":
            rule = options.rule or "paper"
            who = name if rule == "paper" else f"{name}-{rule}"
            return NamedAgent(MakesShortestPath(rule), who, made_for=rule)
        case _ if name in SEEING:
            return _seeing(name, options, seed=seed)
        case _ if is_plugin(name):
            own = load_agent(name)
            looks = own.looks if isinstance(own, LooksFirst) else frozenset()
            return NamedAgent(MakesPlugin(name), own_name(own, name), config=_code({"agent": name}), looks=looks)
    known = ("random", "random-frontier", *SEEING, "shortest-path")
    raise AgentError(
        f"--agent is {name!r}; expected {', '.join(known)}, or your own as package.module:factory."
        f"{did_you_mean(name, known)} Correct the name."
    )


def _seeing(name: SeeingName, options: AgentOptions, *, seed: int) -> NamedAgent:
    if options.perception is None:
        raise AgentError(
            f"--agent {name}: found no --perception; expected what it sees with, such as oracle:mild or "
            "encoder=clip:ID,detector=owlv2:ID. Give it."
        )
    called = perception_called(options.perception)
    if is_oracle(options.perception):
        require_no_model_options(f"--perception {options.perception}", options.model)
    code = _code(own_parts(options.perception))
    if (name == "frontier-vlm") != (options.llm is not None):
        raise AgentError(
            f"--agent {name}: found {'no ' if options.llm is None else ''}--llm-url and --llm-model; expected both for "
            f"frontier-vlm, and neither for other agents. {'Give' if options.llm is None else 'Leave out'} them."
        )
    if options.llm is not None:
        code |= {"llm_url": str(options.llm.base_url), "llm_model": options.llm.model}
    asked = f", asks {options.llm.model}" if options.llm is not None else ""
    truth = " (ground truth)" if options.goal_text == "caption" else ""
    return NamedAgent(
        MakesSeeing(name, options.perception, options.goal_text, options.model, seed, options.llm),
        name,
        condition=f"goal text {options.goal_text}{truth}, sees with {called}{asked}",
        config={
            "perception": called,
            "goal_text": options.goal_text,
            "autocast": options.model.autocast,
            **code,
        },
        looks=looks_of(name),
    )


def _code(plugins: Mapping[str, str]) -> dict[str, str]:
    """The name and digest of each plug-in, which tell its runs from those of changed code."""
    return {f"{option}_code": f"{name}@{plugin_digest(name)}" for option, name in plugins.items()}


def _require_fitting(name: str, options: AgentOptions) -> None:
    """Raises AgentError if an option is given that the agent would ignore."""
    if options.rule is not None and name != "shortest-path":
        raise AgentError(
            f"--rule: found {options.rule!r} for --agent {name}; expected it with --agent shortest-path only, since no "
            "other knows the goal. Leave it out; personal-viz metrics --rule chooses the rule of the table."
        )
    given = {
        "--perception": options.perception,
        "--goal-text": None if options.goal_text == "phrase" else options.goal_text,
        "--device": None if options.model.device == "cpu" else options.model.device,
        "--autocast": None if options.model.autocast == "off" else options.model.autocast,
        "--llm-model": None if options.llm is None else options.llm.model,
    }
    for option, value in given.items() if name not in SEEING else ():
        if value is not None:
            raise AgentError(
                f"{option}: found {value!r} for --agent {name}; expected it with {' or '.join(SEEING)} only, which "
                "see. Leave it out."
            )
