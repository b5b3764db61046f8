"""Two editions of one scene: the first holds a table on the left, the second a lamp farther to the right as well."""

from pathlib import Path

from tests.sim.synthetic import SCENE, example_content, example_episode, example_goal, lattice, write_dataset
from tests.sim.synthetic import write_home as first_edition

__all__ = ["first_edition", "second_edition"]


def second_edition(root: Path) -> Path:
    """The same table, a lamp seen from x 3 to 5, and one medium episode that asks for the lamp."""
    named = {"object_name": "lamp_9", "object_id": 9, "object_category": "lamp"}
    lamp = example_goal(**named, position=[4.0, 0.45, -1.0], view_points=lattice(3.0))
    table = example_goal(view_points=lattice(1.0)[:1])
    asked = {"object_id": "lamp_9", "object_category": "lamp", "start_position": [4.5, 0.0, 2.5]}
    info = {"geodesic_distance": 2.915, "euclidean_distance": 3.5, "closest_goal_object_id": 9}
    goals = {f"{SCENE}.basis.glb_coffee table": [table], f"{SCENE}.basis.glb_lamp": [lamp]}
    content = example_content(goals_by_category=goals, episodes=[example_episode(**asked, info=info)])
    return write_dataset(root, {("medium", SCENE): content})
