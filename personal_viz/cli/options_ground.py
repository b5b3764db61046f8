"""The verb `ground`, whose options are many."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import arg

from grounding.methods.by_name import GrounderName
from grounding.settings import MapLayout

from .options_shared import (
    Clutter,
    Dataset,
    Json,
    Limit,
    ModelAutocast,
    ModelBatch,
    ModelDevice,
    RunId,
    SampleSeed,
    Scenes,
    ScenesDir,
    Splits,
)

_EXPLORED = "Explored maps: "


@dataclass
class Ground:
    """Ground POG episodes on oracle maps, on maps of homes that our explorer walks, or on maps made before."""

    dataset: Dataset
    method: GrounderName
    map: Annotated[
        str,
        arg(help="oracle (texts of the episode files), explore (walk each home, map it), or a folder of <Scene>.npz."),
    ] = "oracle"
    encoder: Annotated[
        str,
        arg(
            help="hashed, minilm (on explored maps: oracle perception in their space), or clip:, siglip:, "
            "blip2-itc256:, blip2-hidden768: and a model id or a folder."
        ),
    ] = "hashed"
    phrases: Annotated[
        Literal["dataset", "rules", "llm"],
        arg(help="Who owns what: the dataset's own (ground truth), parsed from the text by rules, or asked of an LLM."),
    ] = "dataset"
    llm_url: Annotated[str, arg(help="OpenAI-compatible endpoint, such as http://127.0.0.1:11434/v1.")] = ""
    llm_model: Annotated[str, arg(help="Its model.")] = ""
    llm_key_env: Annotated[str, arg(help="Environment variable that holds its key; it is not written anywhere.")] = ""
    all_storeys: Annotated[bool, arg(help="Do not tell the target's storey.")] = False
    layout: Annotated[
        MapLayout | None,
        arg(help=_EXPLORED + "cells of 1 m (grid, by default) or 0.25 m (fine), or objects; map files say theirs."),
    ] = None
    features: Annotated[Literal["patches", "images"], arg(help=_EXPLORED + "what is encoded of each view.")] = "patches"
    blur: Annotated[float, arg(help="Oracle maps: sigma over which objects spread, metres.")] = 0.0
    object_noise: Annotated[float, arg(help="Error of each object's cosines (standard deviation).")] = 0.0
    cell_noise: Annotated[float, arg(help="Oracle maps: the same of each cell.")] = 0.0
    clutter_texts: Annotated[bool, arg(help="Oracle maps: empty observed cells hold objects of other homes.")] = False
    view_noise: Annotated[float, arg(help=_EXPLORED + "error of each patch in each view.")] = 0.0
    confusion: Annotated[float, arg(help=_EXPLORED + "share of objects taken for another one.")] = 0.0
    background: Annotated[bool, arg(help=_EXPLORED + "walls and nameless things say something random.")] = False
    paraphrase: Annotated[
        Literal[0, 1, 2, 3],
        arg(help=_EXPLORED + "captions as they are, reworded, with half of the attributes, or the category only."),
    ] = 0
    clutter: Clutter = 0
    device: ModelDevice = "cpu"
    autocast: ModelAutocast = "off"
    batch: ModelBatch = 8
    sweep: Annotated[str | None, arg(help="NAME=V1,V2,...: one run per value, e.g. object-noise=0,0.1,0.2.")] = None
    scenes_dir: ScenesDir = None
    out: Path = Path("runs")
    scene: Scenes = ()
    split: Splits = ()
    limit: Limit = None
    sample_seed: SampleSeed = 0
    seed: int = 0
    jobs: Annotated[int, arg(help="Worker processes; results do not depend on it.")] = 1
    run_id: RunId = None
    json: Json = False

    def work(self) -> int:
        from grounding.encoders.protocol import ModelOptions
        from grounding.settings import GroundSettings
        from sim.episodes.dataset import PersonalDataset

        from .ground import GroundCall, ground
        from .ground_maps import layout_of_maps

        maps = None if self.map in ("oracle", "explore") else Path(self.map)
        layout = self.layout or "grid"
        if maps is not None:
            dataset = PersonalDataset(self.dataset)
            layout = layout_of_maps(maps, dataset, scenes=self.scene, method=self.method, asked=self.layout)
        settings = GroundSettings(
            self.method,
            map="files" if maps else "explore" if self.map == "explore" else "oracle",
            encoder=self.encoder,
            seed=self.seed,
            all_storeys=self.all_storeys,
            phrases=self.phrases,
            llm_url=self.llm_url,
            llm_model=self.llm_model,
            llm_key_env=self.llm_key_env,
            layout=layout,
            features=self.features,
            blur=self.blur,
            object_noise=self.object_noise,
            cell_noise=self.cell_noise,
            clutter_texts=self.clutter_texts,
            view_noise=self.view_noise,
            confusion=self.confusion,
            background=self.background,
            paraphrase=self.paraphrase,
            home_clutter=self.clutter,
            autocast=self.autocast,
        )
        return ground(
            GroundCall(
                dataset=self.dataset,
                settings=settings,
                maps=maps,
                model=ModelOptions(self.device, self.batch, self.autocast),
                scenes_dir=self.scenes_dir,
                out=self.out,
                run_id=self.run_id,
                scene=self.scene or None,
                split=self.split or None,
                limit=self.limit,
                sample_seed=self.sample_seed,
                jobs=self.jobs,
                json=self.json,
                sweep=self.sweep,
            )
        )
