"""Which of the three sources a scene has, and what every output says of it. Light: no mesh is loaded."""

from collections.abc import Iterable
from pathlib import Path

from sim.episodes.dataset import PersonalDataset
from sim.errors import SceneError
from sim.types import SceneKind

from .plan import HomePlan, load_plan

_LABELS = {
    "schematic": "Schematic homes, recovered from the episode files: no human baseline for PersONAL",
    "invented": "Invented homes, made from a seed: no human baseline for PersONAL",
}

_TERMS = {
    "schematic": (
        "Homes reconstructed from the CC BY episode files of PersONAL; HM3D's terms may apply to your use: "
        "https://matterport.com/matterport-end-user-license-agreement-academic-use-model-data"
    ),
}


def scene_terms(kind: str) -> str:
    """Whose terms a picture or an export of homes of this kind may stand under; empty for invented homes and scans.

    A scan's own licence is known to whoever brings it.
    """
    return _TERMS.get(kind, "")


def scene_label(kind: str) -> str:
    """What every table, figure, export and recording says of results in homes of this kind; empty for scans.

    This is the one source of the words. Answers on oracle maps have no home, and empty words too.
    """
    return _LABELS.get(kind, "")


def scene_labels(kinds: Iterable[str]) -> tuple[str, ...]:
    """The label of each of these kinds once, in order of the kinds; () for scans alone."""
    return tuple(label for kind in sorted(set(kinds)) if (label := scene_label(kind)))


def scene_kind(dataset: PersonalDataset, scene: str, scenes_dir: Path | None) -> SceneKind:
    """The kind of scene that `open_scene` makes of the same arguments.

    An invented home stays one, also when its mesh is read from a file; a corrected plan of a schematic home does not
    make a scan schematic.

    Args:
        dataset: Its folder may hold the scene's plan.
        scene: Scene name, as in the content files.
        scenes_dir: Folder of scans; None = a plan, or else a schematic home.

    Raises:
        SceneError: The plan is damaged or of another home.
    """
    plan = plan_of(dataset, scene)
    if plan is not None and (scenes_dir is None or plan.kind == "invented"):
        return plan.kind
    return "schematic" if scenes_dir is None else "scan"


def common_kind(dataset: PersonalDataset, scenes: Iterable[str], scenes_dir: Path | None) -> SceneKind:
    """The one kind of all these scenes; at least one is named.

    Raises:
        SceneError: They are of several kinds, whose results never share a run; or a plan is damaged.
    """
    examples: dict[SceneKind, str] = {}
    for scene in sorted(scenes):
        examples.setdefault(scene_kind(dataset, scene, scenes_dir), scene)
    if len(examples) > 1:
        found = ", ".join(f"{kind} ({scene})" for kind, scene in sorted(examples.items()))
        raise SceneError(f"{dataset.root}: found scene kinds {found}; expected one kind per run. Choose scenes of one.")
    return next(iter(examples))


def plan_of(dataset: PersonalDataset, scene: str) -> HomePlan | None:
    """The plan that lies beside the episodes, `<dataset.root>/scenes/<scene>.plan.json`; None when there is none.

    Raises:
        SceneError: The plan is damaged or of another home.
    """
    path = dataset.root / "scenes" / f"{scene}.plan.json"
    if not path.is_file():
        return None
    plan = load_plan(path)
    if plan.name != scene:
        raise SceneError(f"{path}: name is {plan.name!r}; expected {scene!r}. Rename the file or correct the plan.")
    return plan
