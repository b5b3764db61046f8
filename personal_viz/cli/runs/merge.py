"""Verb `merge`: joins the shards of a run into the run that the command without `--shard` makes."""

import os
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from grounding.chat.budget import USAGE_FILE, Budget, ChatUsage
from sim.errors import RunFileError
from sim.files import write_whole
from sim.tasks.chat_turns import CHAT_FILE, read_turns
from sim.tasks.run_files import run_texts
from sim.tasks.run_folders import run_folders
from sim.tasks.shards import joined_run, shards_by_run
from sim.words.english import how_many

from ..refusals import writing


@dataclass
class Merge:
    """Join the shards of runs (--shard i/N) into whole runs; missing, double or unfinished shards are refused."""

    out: Positional[Annotated[Path, arg(help="Folder of the whole runs, as --out of the shards.")]]
    shards: Positional[
        Annotated[tuple[Path, ...], arg(help="Run folders of all shards, or a folder of them, such as runs/shards.")]
    ]

    def run(self) -> int:
        groups = list(shards_by_run(run_folders(self.shards)).values())
        runs = [joined_run(folders) for folders in groups]
        texts = {
            self.out / run.info.run_id: run_texts(run) | _chat(folders)
            for run, folders in zip(runs, groups, strict=True)
        }
        done = {folder for folder, files in texts.items() if _holds(folder, files)}
        for folder, folders, run in zip(texts, groups, runs, strict=True):
            if folder not in done:
                _write(folder, texts[folder], pictures_of=folders)
            episodes = how_many(len(run.episodes) + len(run.answers), "episode")
            print(f"{episodes} of {len(folders)} shards {'were' if folder in done else 'written'} in {folder}")
        return 0


def _chat(folders: Sequence[Path]) -> dict[str, str]:
    """What the shards asked of a chat model, in the order of homes, and its cost; no files where they asked nothing."""
    turns = sorted((turn for folder in folders for turn in read_turns(folder)), key=lambda turn: turn.scene)
    if not turns:
        return {}
    used = sum((Budget(folder).used() for folder in folders), ChatUsage())
    return {
        CHAT_FILE: "".join(f"{turn.model_dump_json()}\n" for turn in turns),
        USAGE_FILE: used.model_dump_json() + "\n",
    }


def _holds(folder: Path, texts: Mapping[str, str]) -> bool:
    """Whether the folder holds exactly these files, from an earlier call; False if there is no folder.

    Raises:
        RunFileError: It holds something else.
    """
    if not folder.exists():
        return False
    paths = {path.name: path for path in folder.iterdir() if path.is_file()}
    if paths.keys() == texts.keys() and all(paths[name].read_text("utf-8") == text for name, text in texts.items()):
        return True
    raise RunFileError(
        f"{folder}: exists and is not what these shards give; expected no such folder. Move it away, or give another "
        "OUT."
    )


def _write(folder: Path, texts: Mapping[str, str], *, pictures_of: Sequence[Path]) -> None:
    """Writes a run folder; it has its name only when it is whole."""
    part = folder.with_name(folder.name + ".part")
    with writing(folder, "OUT"):
        shutil.rmtree(part, ignore_errors=True)
        for picture in (path for shard in pictures_of for path in shard.glob("chat/*.png")):
            (part / "chat").mkdir(parents=True, exist_ok=True)
            shutil.copyfile(picture, part / "chat" / picture.name)
        for name, text in sorted(texts.items(), reverse=True):  # run.json last: without it a folder is no run
            write_whole(part / name, text)
        os.rename(part, folder)
