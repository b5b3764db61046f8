"""Options that several verbs share."""

from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import arg

from sim.errors import PersonalVizError
from sim.tasks.workers import RayCluster, Workers
from sim.types import ClutterLevel, Split

Dataset = Annotated[Path, arg(help="Folder with easy/, medium/, hard/ (data/split in the authors' repository).")]
StudyFolder = Annotated[
    Path | None,
    arg(
        help="Folder of a planned study: its people's episodes or home sequences, limits, homes and looks at them; "
        "results go to its folder runs, where study report finds them."
    ),
]
DatasetOrStudy = Annotated[
    Path | None,
    arg(
        help="Folder with easy/, medium/, hard/ (data/split in the authors' repository); with --study only if it moved."
    ),
]
Sequences = Annotated[
    Path | None,
    arg(help="Folder of a set of home sequences, done instead of episodes; --dataset has the homes."),
]
IgnoreMessages = Annotated[
    bool, arg(help="Home sequences: tell nothing after the intro; shortest-path then walks by the intro alone.")
]
Evidence = Annotated[
    tuple[Path, ...],
    arg(help="Further editions of the dataset: their places and objects also make the homes without a scan."),
]
ScenesDir = Annotated[
    Path | None, arg(help="Folder below which <Scene>.glb files lie; without it, homes are rebuilt from the episodes.")
]
Json = Annotated[bool, arg(help="Print one JSON document instead of tables.")]
Scenes = Annotated[tuple[str, ...], arg(help="Scene names; all by default.")]
Splits = Annotated[tuple[Split, ...], arg(help="Splits; all by default.")]
Limit = Annotated[
    int | None, arg(help="At most this many episodes per split: a seeded sample, spread over the scenes.")
]
SampleSeed = Annotated[int, arg(help="Which sample --limit draws; use the same for all runs that you compare.")]
Clutter = Annotated[
    ClutterLevel, arg(help="How much furniture and small things without a caption stand in homes without a scan.")
]
Labels = Annotated[
    Literal["off", "on"],
    arg(help="on writes the category on each object in the robot's pictures, where vision agents can read it."),
]
ModelDevice = Annotated[Literal["cpu", "cuda"], arg(help="Where a real model runs.")]
ModelAutocast = Annotated[
    Literal["off", "bfloat16", "float16"], arg(help="A real model's arithmetic; float16 on cuda only.")
]
ModelBatch = Annotated[int, arg(help="Pictures or texts that a real model encodes together.")]
Out = Annotated[Path | None, arg(help="Folder of run folders: runs by default, with --study the study's own runs.")]
LlmUrl = Annotated[str, arg(help="OpenAI-compatible endpoint, such as http://127.0.0.1:11434/v1.")]
LlmModel = Annotated[str, arg(help="Name of the chat model at that endpoint.")]
LlmKeyEnv = Annotated[
    str, arg(help="Environment variable that holds the endpoint's key; the key is not written anywhere.")
]
MaxCalls = Annotated[
    int | None, arg(help="Most questions to the chat model in this run or shard, over all calls that continue it.")
]
MaxTokens = Annotated[
    int | None, arg(help="Most tokens of the chat model in this run or shard, over all calls that continue it.")
]
Price = Annotated[
    tuple[float, float] | None, arg(help="Money for a million tokens of prompts and of answers, to print the cost.")
]
Jobs = Annotated[int, arg(help="Worker processes; results do not depend on their number.")]
Shard = Annotated[
    str | None,
    arg(help="i/N: the i-th of N parts, for job arrays: whole homes, the same whatever --jobs is. Join them by merge."),
]
On = Annotated[
    Literal["processes", "ray"], arg(help="Who does the work: --jobs processes here, or a Ray cluster (extra ray).")
]
Address = Annotated[
    str | None, arg(help="--on ray: HOST:PORT of the cluster; by default one on this machine, started if need be.")
]
Label = Annotated[
    str | None,
    arg(help="Row name in tables instead of the method's own, for example one for each of your versions."),
]
RunId = Annotated[str | None, arg(help="Folder name below --out; made from the options by default.")]
Rerun = Annotated[
    str | None,
    arg(help="Show episodes live: FILE.rrd, a folder (one file per episode), rerun+http://HOST:PORT/proxy, or spawn."),
]
WithPixels = Annotated[bool, arg(help="Store pictures of licensed scans too; you must have the right to share them.")]
OpenIt = Annotated[bool, arg(help="Open it in a viewer on this machine, until Ctrl-C or until the viewer is closed.")]


def dataset_options(dataset: Path, evidence: tuple[Path, ...]) -> str:
    """The options of a dataset and its evidence as a person types them, for the next verb to call."""
    return " ".join(map(str, ("--dataset", dataset, *(("--evidence", *evidence) if evidence else ()))))


def workers_of(on: str, *, jobs: int, address: str | None, device: str = "cpu") -> Workers:
    """The workers that `--on`, `--jobs` and `--address` name; with `--device cuda`, each of Ray's needs a GPU.

    Raises:
        PersonalVizError: Options of processes and of Ray are mixed.
    """
    if on == "ray":
        if jobs != 1:
            raise PersonalVizError(
                f"--jobs is {jobs} beside --on ray; expected none, because Ray uses every core of its cluster. Leave "
                "it out."
            )
        return RayCluster(address, num_gpus=1.0 if device == "cuda" else 0.0)
    if address is not None:
        raise PersonalVizError(
            f"--address is {address!r} without --on ray; expected both, or none. Add --on ray, or leave it out."
        )
    return jobs
