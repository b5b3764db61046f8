"""A small dataset in the format of the released one: two homes, the first with two storeys; medium has no file."""

from dataclasses import dataclass
from pathlib import Path

from sim.episodes.ownership import queries_for
from sim.types import Split

from ..sim.synthetic import Content, example_content, example_episode, example_goal, example_view_point, write_content


@dataclass(frozen=True)
class Thing:
    """One goal object of the dataset."""

    name: str
    position: tuple[float, float, float]
    floor_id: str
    floor_y: float
    caption: str = ""
    """Empty = no episode asks for it."""
    owner: str = ""

    @property
    def category(self) -> str:
        return self.name.rsplit("_", 1)[0]


HOMES = {
    "HomeOne": (
        Thing("table_1", (2.25, 0.5, 7.75), "0", 0.0, "low oak table with a green bowl", "Ada"),
        Thing("sofa_2", (5.5, 0.4, 7.5), "0", 0.0, "long grey sofa with striped cushions", "Bo"),
        Thing("sofa_3", (9.5, 0.4, 2.5), "0", 0.0, "small yellow leather sofa", "Ada"),
        Thing("lamp_4", (9.25, 1.2, 2.75), "0", 0.0),
        Thing("bed_5", (2.5, 3.4, 7.5), "1", 3.0, "wide bed with a purple blanket", "Bo"),
        Thing("lamp_6", (6.5, 4.2, 2.5), "1", 3.0, "tall copper lamp", "Ada"),
    ),
    "HomeTwo": (
        Thing("chair_1", (-3.5, 0.4, -1.5), "0", 0.0, "white plastic chair", "Carl"),
        Thing("chair_2", (1.5, 0.4, -1.5), "0", 0.0, "carved wooden chair with armrests", "Dee"),
        Thing("mirror_3", (0.5, 1.5, 4.5), "0", 0.0, "oval mirror with a golden frame", "Carl"),
    ),
}


def goal_json(thing: Thing) -> Content:
    x, _, z = thing.position
    stands = [(x + 0.5, z), (x, z - 0.75)]
    return example_goal(
        position=thing.position,
        object_id=int(thing.name.rsplit("_", 1)[1]),
        object_name=thing.name,
        object_category=thing.category,
        floor_id=thing.floor_id,
        view_points=[example_view_point(*xz, y=thing.floor_y, quat_xyzw=[0, 0, 0, 1], iou=0.3) for xz in stands],
    )


def episode_json(scene: str, number: int, thing: Thing, things: tuple[Thing, ...]) -> Content:
    phrases = [f"{other.owner} owns a {other.caption} in the room" for other in things if other.owner]
    return example_episode(
        scene=scene,
        owner=thing.owner,
        episode_id=str(number),
        object_category=thing.category,
        object_id=thing.name,
        description=[thing.caption, "", ""],
        floor_id=thing.floor_id,
        summary=" ".join(f"{phrase}." for phrase in phrases),
        extracted_summary=phrases,
        query=queries_for(thing.owner, thing.category),
        start_position=[0.0, thing.floor_y, 0.0],
        start_rotation=[0.0, 0.0, 0.0, 1.0],
    )


def write_scene(root: Path, split: Split, scene: str, things: tuple[Thing, ...]) -> None:
    goals: dict[str, list[Content]] = {}
    for thing in things:
        goals.setdefault(f"{scene}.basis.glb_{thing.category}", []).append(goal_json(thing))
    targets = [thing for thing in things if thing.owner]
    episodes = [episode_json(scene, number, thing, things) for number, thing in enumerate(targets)]
    write_content(root, split, example_content(goals_by_category=goals, episodes=episodes), scene=scene)


def write_small_dataset(root: Path) -> None:
    """Writes easy with both homes (8 episodes) and hard with only HomeTwo (3 episodes)."""
    for scene, things in HOMES.items():
        write_scene(root, "easy", scene, things)
    write_scene(root, "hard", "HomeTwo", HOMES["HomeTwo"])
