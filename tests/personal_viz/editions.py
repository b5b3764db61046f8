"""Two editions of one scene: the first holds a table on the left, the second a lamp farther to the right as well."""

from pathlib import Path

from tests.sim.synthetic import (
    SCENE,
    Content,
    example_content,
    example_episode,
    example_goal,
    example_view_point,
    write_dataset,
)

_AHEAD = [0.0, 0.0, 0.0, 1.0]


def lattice(x0: float) -> list[Content]:
    """View points from x0 to x0 + 2 m and z 0 to 3 m, every 0.25 m."""
    return [example_view_point(x0 + 0.25 * i, 0.25 * j, quat_xyzw=_AHEAD, iou=0.4) for i in range(9) for j in range(13)]


def first_edition(root: Path) -> Path:
    """A table seen from x 1 to 3, and one easy episode that asks for it."""
    goals = {f"{SCENE}.basis.glb_coffee table": [example_goal(view_points=lattice(1.0))]}
    return write_dataset(root, {("easy", SCENE): example_content(goals_by_category=goals)})


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
