"""What rows of a report are called, for readers: people by condition, agents by name, differences by both."""

PEOPLE = {
    "none": "Human",
    "memory": "Human with memory",
    "memory_topdown": "Human with memory (top-down map)",
    "memory_glb": "Human with memory (3-D model)",
    "map_first": "Human (home first, then text)",
    "map_open": "Human (home and text together)",
    "map_2d": "Human (agents' top-down map)",
}


def is_first_condition(condition: str) -> bool:
    """Whether the others are compared with it, and stand below it: no memory, or the paper's order in POG."""
    return condition in ("none", "map_first")


def row_label(who: str, condition: str) -> str:
    """A row's name for readers; `who` is as in the report's rows: `human`, an agent, or `human - AGENT`."""
    people, minus, agent = who.partition(" - ")
    if people != "human":
        return who if condition == "none" else f"{who} ({condition})"
    return PEOPLE.get(condition, f"Human ({condition})") + minus + agent
