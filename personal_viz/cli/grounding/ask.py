"""Verb `ask`: where something is, asked of a map or a home in free text, without episodes."""

import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from tyro.conf import Positional, UseAppendAction, arg

from grounding.chat.endpoint import Endpoint
from grounding.encoders.by_name import is_model, require_no_model_options
from grounding.encoders.protocol import ModelOptions
from grounding.evaluation.known_home import KnownHome, home_of_dataset, home_of_scan
from grounding.evaluation.settings import GroundSettings
from grounding.evaluation.true_points import AskedScore, read_true_points, score_reply, scored_table
from grounding.maps.best_views import PosedView, Sight, best_views
from grounding.maps.files import MapSource, load_memory, read_map_header
from grounding.maps.home_map import HomeMemory, merged_storeys
from grounding.methods.by_name import takes_objects
from grounding.methods.chat_grounders import CHAT_METHODS
from grounding.methods.free_text import Asker, FoundPlace, Reply, encoder_of_queries
from grounding.phrases.sources import PhraseSource, make_phrases
from grounding.robot.frames import read_robot_frames
from sim.episodes.dataset import PersonalDataset
from sim.errors import AgentError, MissingDependencyError, PersonalVizError, SceneError
from sim.files import write_whole
from sim.homes.open_home import SCAN_SUFFIXES, open_scene
from sim.mesh import Scene
from sim.types import SPLITS

from ..options import (
    Evidence,
    Json,
    LlmKeyEnv,
    LlmModel,
    LlmUrl,
    ModelAutocast,
    ModelBatch,
    ModelDevice,
    ScenesDir,
    WithPixels,
)
from ..output import print_json, print_table, say
from ..refusals import check_options, writing
from .asked_home import asked_home

_CELL_EYE = 0.5
"""Pictures look this high (metres) above an answer of a grid map, whose things have no height."""


_LONGEST_NAME = 255
"""Bytes of a file's name."""
_MOST_DRAWN = 20
"""Questions in one picture; the recording has all."""


class _Asked(NamedTuple):
    """A map that is asked, and what belongs to it."""

    home: HomeMemory
    source: MapSource
    scene: Scene | None
    views: Callable[[], Sequence[PosedView]]
    """Opens the pictures in which answers may be shown."""


@dataclass
class Ask:
    """Ask a map, or a home, where something is, in free text."""

    where: Annotated[
        Positional[str],
        arg(
            help="A map, FILE.npz; or what is explored first: the name of a home of --dataset, or a scan or mesh, "
            "FILE.glb, .gltf, .ply or .obj."
        ),
    ]
    out: Annotated[Path, arg(help="Name of the files: OUT.png and OUT.rrd.")]
    description: Annotated[str, arg(help="Who owns what: a text file, or the paragraph itself.")] = ""
    query: Annotated[UseAppendAction[tuple[str, ...]], arg(help="What to find; give it once per question.")] = ()
    truth: Annotated[
        Path | None,
        arg(help="File of queries with their true points, a JSON object per line; they are asked and scored."),
    ] = None
    interactive: Annotated[bool, arg(help="Then ask questions that are typed, one per line, until the input ends.")] = (
        False
    )
    method: Annotated[
        str | None,
        arg(help="A method of `ground`; by default joint on grid maps, object-dual on maps of objects and in homes."),
    ] = None
    phrases: Annotated[str, arg(help="Reader of the description: rules, llm, or package.module:factory.")] = "rules"
    llm_url: LlmUrl = ""
    llm_model: LlmModel = ""
    llm_key_env: LlmKeyEnv = ""
    encoder: Annotated[
        str, arg(help="Encoder of the map; what the map file says by default, for homes hashed (oracle perception).")
    ] = ""
    dataset: Annotated[
        Path | None,
        arg(help="Folder of a home's episodes, or of a scan's annotations as `annotate` writes them."),
    ] = None
    evidence: Evidence = ()
    scenes_dir: ScenesDir = None
    up: Annotated[
        Literal["y", "z"] | None, arg(help="Axis that is up in a scan; by default what files beside it say, else y.")
    ] = None
    maps: Annotated[Path, arg(help="Folder that keeps explorations and maps of homes.")] = Path("runs/ask")
    with_pixels: WithPixels = False
    device: ModelDevice = "cpu"
    autocast: ModelAutocast = "off"
    batch: ModelBatch = 8
    json: Json = False

    def run(self) -> int:
        check_options(self)
        self._require_options()
        truths = read_true_points(self.truth) if self.truth is not None else []
        if not (self.query or truths or self.interactive):
            raise PersonalVizError(
                "ask: found no question; expected --query, --truth or --interactive. "
                'Example: --query "Lily\'s backpack".'
            )
        description, phrases = self._description, self._phrase_source
        asked = self._opened()
        merged = merged_storeys(asked.home)
        name = self.encoder or asked.source.encoder or "hashed"
        if not is_model(name):
            require_no_model_options(f"--encoder {name}", self._model)
        encoder = encoder_of_queries(merged, name, options=self._model)
        asker = Asker(asked.home, encoder=encoder, phrases=phrases, method=self.method, chat=self._chat)
        replies = [asker.ask(query, description=description) for query in self.query]
        scores: list[AskedScore] = []
        for truth in truths:
            told = description if truth.description is None else truth.description
            replies.append(asker.ask(truth.query, description=told))
            scores.append(score_reply(replies[-1], truth, asked.home, T_map_recording=_T_map_recording(asked.source)))
        documents = [_document(reply, asker.method, asked.source) for reply in replies]
        if not self.json:
            _print(asked.home, replies, asked.source)
        for query in _typed() if self.interactive else ():
            replies.append(asker.ask(query, description=description))
            documents.append(_document(replies[-1], asker.method, asked.source))
            if not self.json:
                _print(asked.home, replies[-1:], asked.source)
        if self.json:
            print_json(_all(documents, scores))
        elif scores:
            _print_scores(scores, asker.method)
        written = self._written(asked, asker, replies)
        say(written) if self.json else print(written)
        return 0

    def _require_options(self) -> None:
        """Refuses options that would be ignored."""
        is_home, has_llm = not (self._is_map or self._is_scan), self.phrases == "llm" or self.method in CHAT_METHODS
        with_llm = "--phrases llm or a method that asks a chat model"
        for option, is_given, fits, where in (
            ("--dataset", self.dataset is not None, not self._is_map, "the name of a home or a scan's file"),
            ("--evidence", bool(self.evidence), is_home, "the name of a home"),
            ("--up", self.up is not None, self._is_scan, "a scan's file"),
            ("--scenes-dir", self.scenes_dir is not None, is_home, "the name of a home"),
            ("--llm-url", bool(self.llm_url), has_llm, with_llm),
            ("--llm-model", bool(self.llm_model), has_llm, with_llm),
            ("--llm-key-env", bool(self.llm_key_env), has_llm, with_llm),
        ):
            if is_given and not fits:
                raise PersonalVizError(
                    f"ask: {option} is given for {self.where} with --phrases {self.phrases}; expected it with {where} "
                    "only. Leave it out."
                )

    @property
    def _is_map(self) -> bool:
        return self.where.endswith(".npz")

    @property
    def _is_scan(self) -> bool:
        return self.where.endswith(SCAN_SUFFIXES)

    @property
    def _description(self) -> str:
        """The paragraph, from the file that the option names or as it was typed."""
        path = Path(self.description)
        is_name = 0 < len(self.description.encode()) <= _LONGEST_NAME and "\n" not in self.description
        if not is_name or not (path.suffix in (".txt", ".md") or path.is_file()):
            return self.description
        try:
            return path.read_text(encoding="utf-8").strip()
        except (OSError, UnicodeDecodeError) as error:
            raise PersonalVizError(
                f"--description {path}: cannot be read ({error}); expected a text file in UTF-8. Check the path, or "
                "give the paragraph itself."
            ) from None

    @cached_property
    def _phrase_source(self) -> PhraseSource:
        if self.phrases == "dataset":
            raise AgentError(
                "--phrases is 'dataset'; expected rules, llm, or your own as package.module:factory, because free text "
                "has no phrases of a dataset. Leave it out for rules."
            )
        return make_phrases(self.phrases, chat=self._chat)

    @cached_property
    def _chat(self) -> Endpoint | None:
        """The model of the phrases or of the method."""
        return self._settings.endpoint()

    @property
    def _settings(self) -> GroundSettings:
        """The settings with which `ground` would map a home, as things by default, and read the description."""
        method = self.method or "object-dual"
        return GroundSettings(
            method,
            map="explore",
            layout="objects" if takes_objects(method) else "grid",
            encoder=self.encoder or "hashed",
            phrases=self.phrases,
            llm_url=self.llm_url,
            llm_model=self.llm_model,
            llm_key_env=self.llm_key_env,
        )

    @property
    def _model(self) -> ModelOptions:
        return ModelOptions(self.device, self.batch, self.autocast)

    def _opened(self) -> _Asked:
        """The map of the file or of the home."""
        if self._is_map:
            path = Path(self.where)
            source = read_map_header(path).source
            return _Asked(load_memory(path), source, None, lambda: _recorded_views(source))
        found = asked_home(self._home(), self._settings, folder=self.maps, model=self._model, say_so=say)
        return _Asked(load_memory(found.file), read_map_header(found.file).source, found.scene, lambda: found.views)

    def _home(self) -> KnownHome:
        """The home that is named, or that of a scan's file."""
        if self._is_scan:
            return home_of_scan(Path(self.where), up=self.up, annotations=self.dataset)
        if self.dataset is None:
            raise PersonalVizError(
                f"ask: found {self.where!r} without --dataset; expected a map (FILE.npz), a scan "
                f"({', '.join(SCAN_SUFFIXES)}), or the name of a home with its --dataset. Make a map with "
                "personal-viz map, or give --dataset."
            )
        episodes = PersonalDataset(self.dataset, evidence=self.evidence)
        return home_of_dataset(episodes, open_scene(episodes, self.where, scenes_dir=self.scenes_dir))

    def _written(self, asked: _Asked, asker: Asker, replies: Sequence[Reply]) -> str:
        """Writes picture and recording; returns a line that says so."""
        if not replies:
            return "Nothing was asked, and nothing is written."
        if asked.source.kind == "scan" and not self.with_pixels:
            return (
                f"Not written: {self.out}.png and .rrd would show the licensed scan {asked.source.scene}. Give "
                "--with-pixels if you may keep such files."
            )
        from recordings.replay import record_memory

        from .ask_picture import answers_png

        views, drawn = asked.views(), replies[:_MOST_DRAWN]
        sights = [_sights(views, reply) for reply in drawn]
        png, rrd = (self.out.with_name(self.out.name + end) for end in (".png", ".rrd"))
        title = f"{asked.source.scene}, {asker.method}" + (f"; {asked.scene.label}" if asked.scene else "")
        with writing(png):
            png.parent.mkdir(parents=True, exist_ok=True)
            write_whole(png, answers_png(asked.home, asker.memory, drawn, sights, title=title))
        record_memory(
            asked.home,
            name=asked.source.scene,
            out=rrd,
            scene=asked.scene,
            with_pixels=self.with_pixels,
            asked=replies,
            searched=asker.memory,
        )
        some = f" ({len(drawn)} of {len(replies)} questions are drawn)" if len(drawn) < len(replies) else ""
        return f"Written to {png}{some} and {rrd}. See it with: rerun {rrd}"


def _typed() -> Iterator[str]:
    """The lines of standard input."""
    if sys.stdin.isatty():
        print("Type what to find, one question per line; Ctrl-D ends.", file=sys.stderr)
    try:
        for line in sys.stdin:
            if line.strip():
                yield line.strip()
    except KeyboardInterrupt:  # the answers so far are kept
        return


def _sights(views: Sequence[PosedView], reply: Reply) -> list[Sight]:
    """The pictures that see the best place."""
    if not reply.places or not views:
        return []
    from .ask_picture import MOST_SIGHTS

    x, y, z = reply.places[0].position
    above = _CELL_EYE if reply.places[0].height == 0 else 0.0
    return best_views(views, (x, y + above, z), count=MOST_SIGHTS)


def _T_map_recording(source: MapSource) -> NDArray[np.float64] | None:
    return None if source.recording is None else np.array(source.recording.T_map_recording)


def _in_recording(place: FoundPlace, source: MapSource) -> list[float] | None:
    """The place in the recording's own frame; None where there is no other frame."""
    T_map_recording = _T_map_recording(source)
    if T_map_recording is None:
        return None
    T = np.linalg.inv(T_map_recording)
    return _rounded(T[:3, :3] @ np.array(place.position) + T[:3, 3])


def _recorded_views(source: MapSource) -> Sequence[PosedView]:
    """The pictures of the recording from which a map was made; none if it is not there any more."""
    if source.recording is None:
        return ()
    recording, path = source.recording, Path(source.recording.path)
    if not path.exists():
        say(f"The recording {path} is not there: answers are shown on the map alone.")
        return ()
    T_base_camera = recording.T_base_camera
    try:
        frames, _ = read_robot_frames(
            path,
            up=",".join(map(str, recording.T_map_recording[1][:3])),  # the row that gives y
            camera_axes=recording.camera_axes,
            depth_per_metre=recording.depth_per_metre,
            topics=recording.topics,
            T_base_camera=None if T_base_camera is None else np.array(T_base_camera),
            every=recording.every,
        )
    except (SceneError, MissingDependencyError) as error:
        say(f"Answers are shown on the map alone: {error}")
        return ()
    return frames.views


def _rounded(numbers: Sequence[float] | NDArray[np.float64]) -> list[float]:
    return [round(float(number), 3) + 0.0 for number in numbers]  # no -0.0


def _document(reply: Reply, method: str, source: MapSource) -> dict[str, Any]:
    return {
        "query": reply.query,
        "points": [
            {
                "map": _rounded(place.position),
                "recording": _in_recording(place, source),
                "storey": place.storey,
                "height": round(place.height, 3) + 0.0,
                "score": round(place.score, 4),
            }
            for place in reply.places
        ],
        "phrase": reply.phrase,
        "method": method,
    }


def _all(documents: list[dict[str, Any]], scores: Sequence[AskedScore]) -> Any:
    """One document for one question, a list for several; with `--truth` the scores stand beside them."""
    if scores:
        each = [score.model_dump(mode="json") for score in scores]
        return {"answers": documents, "scores": each, "table": scored_table(scores)}
    return documents[0] if len(documents) == 1 else documents


def _print(home: HomeMemory, replies: Sequence[Reply], source: MapSource) -> None:
    for reply in replies:
        print(f"{reply.query}: {reply.phrase or 'no phrase of the description means it'}")
        if reply.grounding.fell_back:
            print("  the chat model gave nothing to use: a method without one answered")
        for rank, place in enumerate(reply.places, start=1):
            recorded = _in_recording(place, source)
            own = f", in the recording {_words(recorded)}" if recorded is not None else ""
            storey = f", storey {place.storey}" if len(home.storeys) > 1 else ""
            print(
                f"  {rank}. {_words(_rounded(place.position))}{own}{storey}, {place.height:.2f} m above the floor, "
                f"score {place.score:.3f}"
            )
        if not reply.places:
            print("  the map holds no place")


def _words(numbers: Sequence[float]) -> str:
    return f"({', '.join(f'{number:.2f}' for number in numbers)})"


def _print_scores(scores: Sequence[AskedScore], method: str) -> None:
    table = scored_table(scores)
    names = [name for name in (*SPLITS, "total") if table["n"][name]]
    rows = [
        (label, *("-" if table[key][name] is None else f"{table[key][name]:.1f}" for name in names))
        for key, label in (("sr", f"{method}: SR (%)"), ("top3", "one of three (%)"))
    ]
    rows.append(("queries", *(str(table["n"][name]) for name in names)))
    print_table("Answers within the radius of a true point", ["", *names], rows)
