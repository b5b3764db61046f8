"""Tells which of the three sources a scene has, and how outputs label it. It loads no mesh, so it is fast."""

from collections.abc import Iterable
from pathlib import Path

from sim.episodes.dataset import PersonalDataset
from sim.errors import SceneError
from sim.types import SceneKind

from .plan import plan_of

_LABELS = {
    "schematic": "Schematic homes, recovered from the episode files: no human baseline for PersONAL",
    "invented": "Invented homes, made from a seed: no human baseline for PersONAL",
}

HM3D_TERMS = "https://matterport.com/matterport-end-user-license-agreement-academic-use-model-data"
"""Matterport's agreement on HM3D's scans."""
_TERMS = {
    "schematic": (
        "Homes reconstructed from the CC BY episode files of PersONAL; HM3D's terms may apply to your use: "
        + HM3D_TERMS
    ),
}


def scene_terms(kind: str) -> str:
    """Licence terms that may apply to pictures and exports of homes of this kind; empty for invented homes and scans.

    The person who brings a scan knows its licence.
    """
    return _TERMS.get(kind, "")


def scene_label(kind: str) -> str:
    """The label of results in homes of this kind in tables, figures, exports and recordings; empty for scans.

    All outputs take the words from here. Answers on oracle maps have no home, so their label is empty too.
    """
    return _LABELS.get(kind, "")


def scene_labels(kinds: Iterable[str]) -> tuple[str, ...]:
    """The labels of these kinds, each once, in order of the kinds; () for scans alone."""
    return tuple(label for kind in sorted(set(kinds)) if (label := scene_label(kind)))


def scene_kind(dataset: PersonalDataset, scene: str, scenes_dir: Path | None) -> SceneKind:
    """The kind of scene that `open_scene` makes of the same arguments.

    An invented home is still invented when its mesh is read from a file, and a scan with a corrected plan of its
    schematic home beside it is still a scan.

    Raises:
        SceneError: The plan is damaged or of another home, or the dataset has evidence, which is of no use for a scan.
    """
    if scenes_dir is not None and dataset.evidence:
        raise SceneError(
            f"{scenes_dir}: found evidence {dataset.evidence[0].root} for the scan of {scene!r}; expected none, since "
            "a scan shows its whole home. Leave out --evidence, or --scenes-dir to use the home made from the episodes."
        )
    plan = plan_of(dataset, scene)
    if plan is not None and (scenes_dir is None or plan.kind == "invented"):
        return plan.kind
    return "schematic" if scenes_dir is None else "scan"


def common_kind(dataset: PersonalDataset, scenes: Iterable[str], scenes_dir: Path | None) -> SceneKind:
    """The common kind of these scenes; `scenes` names at least one.

    Raises:
        SceneError: They are of several kinds, whose results never share a run; or a plan is damaged.
    """
    examples: dict[SceneKind, str] = {}
    for scene in sorted(scenes):
        examples.setdefault(scene_kind(dataset, scene, scenes_dir), scene)
    if len(examples) > 1:
        found = ", ".join(f"{kind} ({scene})" for kind, scene in sorted(examples.items()))
        message = f"{dataset.root}: found scene kinds {found}; expected one kind per run. Choose scenes of one kind."
        raise SceneError(message)
    return next(iter(examples))
