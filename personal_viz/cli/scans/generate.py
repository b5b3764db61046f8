"""Verb `generate`: PersONAL-format episodes on annotated scans, or new episodes on the homes of an edition."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import Positional, arg

from sim.errors import PersonalVizError
from sim.types import SPLITS, Split

from ...progress import counted
from ..options import Json, ScenesDir
from ..output import print_json, print_table
from ..refusals import check_options, writing

if TYPE_CHECKING:
    from grounding.chat.protocol import Chat
    from sim.authoring.edition import Generated

_SHOWN_LEFT_OUT = 5
DEFAULT_SEQUENCES = 300
Count = Annotated[int, arg(help="Episodes of this split in each scene; 0 = none.")]


@dataclass
class Generate:
    """Make PersONAL-format episodes on annotated scans, or new ones on the homes of an edition."""

    dataset: Annotated[
        Positional[Path],
        arg(help="Folder with annotations/<Scene>.jsonl, or an edition, whose captioned objects get new owners."),
    ]
    scenes_dir: ScenesDir = None
    scene: Annotated[
        tuple[str, ...], arg(aliases=("--scenes",), help="Scene names; all annotated ones by default.")
    ] = ()
    captions: Annotated[
        Path | None,
        arg(help="Folder of `annotate --dataset` whose accepted captions replace those of the edition DATASET."),
    ] = None
    sequences: Annotated[
        tuple[int, ...] | None,
        arg(
            metavar="[N]",
            help="Make N home sequences over all scenes (300 without a number) instead of episodes; the numbers of "
            "episodes do not count then.",
        ),
    ] = None
    seed: Annotated[int, arg(help="The same seed gives the same files.")] = 0
    easy: Count = 20
    medium: Count = 20
    hard: Count = 20
    starts: Annotated[
        Literal["released", "paper"],
        arg(
            help="released: 2-4, 3-7, 3-11 m of walking to the nearest view point, looking anywhere; paper: to the "
            "first view point, looking away from the target, as all released episodes do."
        ),
    ] = "released"
    describe: Annotated[
        Literal["templates", "llm"],
        arg(help="What writes the paragraphs; one counts only if the phrases `rules` read every owner back from it."),
    ] = "templates"
    llm_url: Annotated[str, arg(help="OpenAI-compatible endpoint, such as http://127.0.0.1:11434/v1.")] = ""
    llm_model: Annotated[str, arg(help="Name of the language model at that endpoint.")] = ""
    llm_key_env: Annotated[
        str, arg(help="Environment variable that holds the endpoint's key; the key is not written anywhere.")
    ] = ""
    out: Annotated[Path | None, arg(help="Folder of the new episodes; by default, that of the annotations.")] = None
    replace: Annotated[bool, arg(help="Overwrite episodes of the same scenes.")] = False
    json: Json = False

    def run(self) -> int:
        from grounding.phrases.described import Describer
        from sim.authoring.edition import (
            Generated,
            draw_edition,
            edition_files,
            edits_before,
            require_free,
            scenes_to_ask,
            write_edition,
        )
        from sim.authoring.searches import Style

        check_options(self)
        if self.captions is not None and not (self.captions / "opinions").is_dir():
            raise PersonalVizError(
                f"--captions {self.captions}: found no opinions in it; expected the --out of `annotate --dataset`. "
                "Give that folder."
            )
        if self.sequences is not None:
            return self._make_sequences(*(self.sequences or (DEFAULT_SEQUENCES,)))
        counts: dict[Split, int] = {"easy": self.easy, "medium": self.medium, "hard": self.hard}
        describer = Describer(self._chat())
        out = self.out or self.dataset
        scenes = tuple(dict.fromkeys(self.scene)) or scenes_to_ask(self.dataset)
        require_free(out, self.dataset, scenes, counts, replace=self.replace)
        style = Style(self.starts, describer, "Annotate more objects, ask for fewer episodes, or take another --seed.")
        with counted("scenes", len(scenes)) as progress:
            edition = draw_edition(
                self.dataset,
                scenes,
                scenes_dir=self.scenes_dir,
                counts=counts,
                seed=self.seed,
                style=style,
                before=edits_before(out, self.dataset),
                refined=self.captions,
                on_scene=lambda _: progress.add(),
            )
        made = Generated(
            seed=self.seed,
            starts=self.starts,
            counts=counts,
            descriptions=dict(sorted(describer.counts.items())),
            scenes=dict(edition.sources),
        )
        with writing(out):
            write_edition(out, edition_files(edition, made))
        if self.json:
            print_json({"out": str(out), **made.model_dump(mode="json")})
        else:
            _print_summary(made, out)
            num_changed = sum(map(len, edition.changes.values()))
            print(f"Objects that changed since the edition before: {num_changed}, in {out / 'changes.md'}.")
            print(f"Next: personal-viz run --agent shortest-path --dataset {out}")
        return 0

    def _make_sequences(self, count: int, *more: int) -> int:
        from sim.authoring.edition import scenes_to_ask
        from sim.authoring.sequences.generation import draw_sequences, require_free_set, write_sequences
        from sim.authoring.sequences.stories import SHARES

        if count < 1 or more:
            given = " ".join(map(str, (count, *more)))
            raise PersonalVizError(
                f"--sequences is {given}; expected one whole number from 1. Give one, or none for 300."
            )
        if self.out is None or self.describe == "llm":
            raise PersonalVizError(
                f"--sequences {count}: --out is {self.out} and --describe {self.describe!r}; expected a folder of its "
                "own for the set, and descriptions by templates. Give --out, and leave --describe out."
            )
        scenes = tuple(dict.fromkeys(self.scene)) or scenes_to_ask(self.dataset)
        require_free_set(self.out, scenes, replace=self.replace)
        with counted("scenes", len(scenes)) as progress:
            drawn = draw_sequences(
                self.dataset,
                scenes,
                scenes_dir=self.scenes_dir,
                count=count,
                seed=self.seed,
                starts=self.starts,
                refined=self.captions,
                on_scene=lambda _: progress.add(),
            )
        with writing(self.out):
            write_sequences(self.out, drawn)
        total = drawn.total
        if self.json:
            print_json(
                {
                    "sequences": total.splits.total(),
                    "subtasks": total.needs.kinds.total(),
                    "by_kind": {kind: total.needs.kinds[kind] for kind in SHARES},
                    "refused": total.refused,
                }
            )
            return 0
        for line in total.lines:
            print(line)
        kinds = ", ".join(f"{kind} {total.needs.kinds[kind]}" for kind in SHARES)
        print(f"{total.splits.total()} of {count} sequences with {total.needs.kinds.total()} searches ({kinds}).")
        print(f"Written to {self.out}. Next: personal-viz validate --dataset {self.out}")
        return 0

    def _chat(self) -> "Chat | None":
        """The language model of `--describe llm`; None for templates.

        Raises:
            PersonalVizError: The options of the endpoint do not fit.
        """
        given = (self.llm_url, self.llm_model, self.llm_key_env)
        if (self.describe == "llm") != any(given) or (self.describe == "llm" and not all(given[:2])):
            raise PersonalVizError(
                f"--describe is {self.describe!r} with --llm-url {self.llm_url!r} and --llm-model {self.llm_model!r}; "
                "expected both for llm, and none for templates. Add or leave them out."
            )
        if self.describe == "templates":
            return None
        from grounding.chat.endpoint import Endpoint, llm_options

        return Endpoint(llm_options(self.llm_url, self.llm_model, self.llm_key_env))


def _print_summary(made: "Generated", out: Path) -> None:
    rows = [
        (name, str(source.num_objects), str(len(source.left_out)), *(str(made.counts[split]) for split in SPLITS))
        for name, source in made.scenes.items()
    ]
    print_table("Episodes", ("scene", "objects", "left out", *SPLITS), rows)
    left_out = [f"{name}: {reason}" for name, source in made.scenes.items() for reason in source.left_out]
    if left_out:
        more = f"; {len(left_out) - _SHOWN_LEFT_OUT} more (--json lists all)" if len(left_out) > _SHOWN_LEFT_OUT else ""
        print(f"Left out: {'; '.join(left_out[:_SHOWN_LEFT_OUT])}{more}.")
    written = ", ".join(f"{number} {way}" for way, number in made.descriptions.items())
    print(f"Descriptions, each read back by rules: {written}. Starts: {made.starts}. Seed {made.seed}.")
    print(f"Written to {out} and, for habitat-lab's own class, {out / 'objectnav'}.")
