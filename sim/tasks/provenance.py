"""The origin of a run: program versions, state of the code, time."""

import datetime
import subprocess
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Literal

from sim.episodes.dataset import PersonalDataset
from sim.types import SceneKind, SuccessRule, WhoKind

from .run_files import RunInfo

_PACKAGES = ("personal-viz", "numpy", "numba", "embreex", "imagecodecs", "open3d-cpu", "open3d", "torch", "trimesh")


def make_run_info(
    run_id: str,
    *,
    who: str,
    who_kind: WhoKind,
    scene_kind: SceneKind | Literal["oracle-map"],
    dataset_digest: str,
    condition: str = "none",
    seed: int | None = None,
    config: dict[str, str | int | float | bool | None] | None = None,
    made_for: SuccessRule | None = None,
    labels: bool = False,
) -> RunInfo:
    """`run.json` of a new run on this machine, now."""
    return RunInfo(
        run_id=run_id,
        who=who,
        who_kind=who_kind,
        condition=condition,
        scene_kind=scene_kind,
        dataset_digest=dataset_digest,
        seed=seed,
        config=config or {},
        versions=package_versions(),
        git_commit=git_commit(),
        created_utc=datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        made_for=made_for,
        labels=labels,
    )


def evidence_config(dataset: PersonalDataset) -> dict[str, str]:
    """The entry of a run's config that names the evidence from which its homes were recovered; empty without any."""
    digests = " ".join(edition.digest()[:12] for edition in dataset.evidence)
    return {"evidence": digests} if digests else {}


def program_release() -> str:
    """The installed version of this program, with its commit in a checkout, as a name that a person can look up."""
    commit = git_commit()
    return f"personal-viz {version('personal-viz')}" + (f" (commit {commit[:12]})" if commit else "")


def package_versions() -> dict[str, str]:
    """Versions of the installed packages that may affect results."""
    found = {}
    for name in _PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found


def git_commit() -> str | None:
    """Commit of this checkout; None outside a checkout."""
    try:
        done = subprocess.run(
            ["git", "rev-parse", "HEAD"], cwd=Path(__file__).parent, capture_output=True, text=True, timeout=10
        )
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout.strip() or None if done.returncode == 0 else None
