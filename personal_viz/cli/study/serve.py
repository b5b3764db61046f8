"""Verb `study serve`: serves a planned study, or one home for a try, until Ctrl-C."""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

from human_study.design.plan import PLAN_FILE, StudyPlan, StudyScene, load_plan, save_plan
from human_study.design.planning import make_plan
from human_study.design.secrets import StudySecrets, make_secrets, token_hash
from human_study.design.study import STUDY_FILE, StudyConfig, load_study, save_study
from human_study.store.database import require_free_space
from human_study.store.store import StudyStore, open_store
from personal_viz.study_app.gateway.http import listen
from personal_viz.study_app.gateway.options import ServeOptions, require_may_serve
from personal_viz.study_app.study_files import require_texts
from sim.episodes.dataset import PersonalDataset, sample_keys
from sim.errors import StudyError
from sim.homes.kind import scene_kind
from sim.types import SPLITS, EpisodeKey

from ..options import Clutter, Dataset, Limit, Rerun, ScenesDir, Splits, WithPixels
from ..refusals import check_options, require_folder, require_no_scan


@dataclass
class StudyServe:
    """Serve a planned study, or try one home's episodes with --scene; prints a personal link per participant."""

    dataset: Dataset
    study: Positional[Path | None] = None
    """Folder that `study plan` has planned."""
    scene: Annotated[str | None, arg(help="Without a study: one POG and one PAN participant on this home.")] = None
    scenes_dir: ScenesDir = None
    out: Annotated[Path | None, arg(help="With --scene: the folder; runs/study-<scene> by default.")] = None
    split: Splits = ()
    limit: Limit = None
    seed: int = 0
    actions: Literal["paper4", "paper6"] = "paper4"
    clutter: Clutter = 0
    rerun: Rerun = None
    with_pixels: WithPixels = False
    port: int = 8080
    bind: Annotated[str, arg(help="Address to listen on; beyond loopback only with --public.")] = "127.0.0.1"
    public: Annotated[bool, arg(help="People come from other machines; needs TLS or a proxy that does it.")] = False
    host: Annotated[tuple[str, ...], arg(help="Names under which browsers reach the study.")] = ()
    tls_cert: Path | None = None
    tls_key: Path | None = None
    proxy: Annotated[str | None, arg(help="Address of the reverse proxy that does TLS.")] = None
    i_have_rights: Annotated[bool, arg(help="The scans' licence allows sending them to participants.")] = False
    pilot: Annotated[bool, arg(help="Serve without an ethics id; the records say so for ever.")] = False
    workers: Annotated[int | None, arg(help="viser processes; one per core, at most four.")] = None
    max_people: Annotated[int, arg(help="Participants connected at once.")] = 200
    per_address: Annotated[int, arg(help="Connections from one address; loopback and the proxy are not limited.")] = 64
    dashboard_port: Annotated[
        int, arg(help="Port of the researcher's page, on this machine only; 0 takes a free one.")
    ] = 0

    def run(self) -> int:
        same = {field.name for field in dataclasses.fields(ServeOptions)} & set(vars(self))
        return self.serve(ServeOptions(hosts=self.host, **{name: getattr(self, name) for name in same}))

    def serve(self, options: ServeOptions) -> int:
        """Serves until Ctrl-C or SIGTERM; an existing study folder continues where it stopped."""
        if (self.study is None) == (self.scene is None):
            found = "both a study and --scene" if self.study else "neither a study nor --scene"
            raise StudyError(
                f"study serve: found {found}; expected one. Give a planned folder, or --scene to try a home."
            )
        if self.study is None:
            return self._serve_scene(self.scene or "", dataclasses.replace(options, pilot=True))
        for name in ("out", "split", "limit", "seed", "clutter"):
            if getattr(self, name):
                raise StudyError(
                    f"--{name}: is for --scene; expected it in {STUDY_FILE} of a planned study. Leave it out."
                )
        return self._serve_planned(self.study, options)

    def _serve_planned(self, folder: Path, options: ServeOptions) -> int:
        """Serves a study that `study plan` has planned."""
        config = load_study(folder)
        plan = load_plan(folder, config)
        require_texts(folder, config, plan)
        digest = PersonalDataset(self.dataset).digest()
        if config.dataset.sha256 != digest:
            raise StudyError(
                f"--dataset {self.dataset}: its digest is {digest[:12]}; expected {config.dataset.sha256[:12]}, the "
                "study's. Give the dataset that the study was planned with."
            )
        require_may_serve(options, config, [scene.kind for scene in plan.scenes])
        return self._serve(folder, config, plan, options)

    def _serve_scene(self, scene: str, options: ServeOptions) -> int:
        """Serves the episodes of one home to a POG and a PAN participant, without pages before; always a pilot."""
        check_options(self)
        episodes = PersonalDataset(self.dataset)
        episodes.require_scene(scene)
        folder = self.out or Path("runs") / f"study-{scene}"
        listen(options.bind, options.port).close()  # a taken port is reported before anything is written
        require_folder(folder)
        kind = scene_kind(episodes, scene, self.scenes_dir)
        require_no_scan(kind, clutter=self.clutter)
        config = self._config(episodes, scene)
        keys = [episode.key for episode in episodes.episodes(splits=self.split or SPLITS, scenes=(scene,))]
        if not keys:
            raise StudyError(
                f"{self.dataset}: scene {scene!r} has no episode in {self.split}; expected one. Leave --split out."
            )
        home = StudyScene(name=scene, kind=kind, clutter=self.clutter)
        return self._serve(folder, config, self._kept_plan(folder, config, home, keys), options)

    def _config(self, episodes: PersonalDataset, scene: str) -> StudyConfig:
        """The settings of a study in one home."""
        return StudyConfig.model_validate(
            {
                "study": f"{scene[:20]}-{self.seed}"[:32],
                "dataset": {
                    "sha256": episodes.digest(),
                    "splits": dict.fromkeys(self.split or SPLITS, "all"),
                    "scenes": (scene,),
                    "stratify": "none",
                    "max_per_scene": None,
                    "seed": self.seed,
                },
                "task": ("pog", "pan"),
                "actions": self.actions,
                "design": {"kind": "crossed", "raters_per_episode": 1},
                "pog": {"conditions": ("map_open",)},
                "flow": ("instructions",),
                "practice": {"pan": 0, "pog": 0},
                "checks": {"every": None},
                "breaks": {"every": None, "sitting_max": None},
                "clutter": self.clutter,
            }
        )

    def _kept_plan(self, folder: Path, config: StudyConfig, home: StudyScene, keys: Sequence[EpisodeKey]) -> StudyPlan:
        """The folder's plan, which is made only once.

        Raises:
            StudyError: The folder's plan was made with other options.
        """
        save_study(folder, config)
        drawn = sample_keys(sorted(keys), per_split=self.limit, seed=config.dataset.seed)
        plan = make_plan(config, [home], drawn, is_pilot=True)
        if not (folder / PLAN_FILE).is_file():
            save_plan(folder, plan)
            return plan
        found = load_plan(folder, config)
        if found != plan and (self.split or self.limit is not None):
            raise StudyError(
                f"{folder / PLAN_FILE}: was made with another --split or --limit; expected the same. "
                "Leave both out to go on with it, or give another --out."
            )
        return found

    def _serve(self, folder: Path, config: StudyConfig, plan: StudyPlan, options: ServeOptions) -> int:
        from personal_viz.study_app.operator.service import require_many_recordings, serve_study

        require_free_space(folder)
        require_many_recordings(self.rerun, plan)
        with open_store(folder, config, plan) as store:
            secrets = make_secrets(folder, [person.code for person in plan.participants])
            _register(store, plan, secrets)
            if options.pilot and not plan.is_pilot:
                store.mark_pilot()
            serve_study(
                store,
                folder=folder,
                dataset=self.dataset,
                scenes_dir=self.scenes_dir,
                platform_key=secrets.key_bytes,
                links=[(person.task.upper(), person.code, secrets.tokens[person.code]) for person in plan.participants],
                options=options,
                rerun=self.rerun,
                with_pixels=self.with_pixels,
            )
        print(f"Stopped. Everything is in {folder}; see it with: personal-viz study export {folder}")
        return 0


def _register(store: StudyStore, plan: StudyPlan, secrets: StudySecrets) -> None:
    """Registers the participants that the store does not know yet.

    The tokens are already on disk, so a kill in between loses nothing.
    """
    for person in plan.participants:
        token = secrets.tokens[person.code]
        if store.code_of_token(token) is None:
            store.add_participant(person, token_hash(token))
