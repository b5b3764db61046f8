"""Appends finished runs to a run folder, so that a kill loses only unfinished episodes."""

import json
from collections.abc import Container, Sequence
from pathlib import Path
from typing import Any, ClassVar

from pydantic import BaseModel

from sim.errors import RunFileError
from sim.files import append_whole, write_whole
from sim.types import EpisodeKey

from .chat_turns import CHAT_FILE, NO_CHAT, Transcript, turn_from_line
from .run_files import Answer, EpisodeRun, Measures, Reported, RunInfo, read_run, read_run_info


class RunWriter:
    """Appends finished episodes and answers to a run folder; a killed run resumes where it stopped."""

    _names: ClassVar[tuple[str, ...]] = ("steps.jsonl", "answers.jsonl", "reported.jsonl")
    """The files of results."""

    def __init__(self, folder: Path, info: RunInfo) -> None:
        """Opens the folder and cuts off an incomplete tail left by a kill; the first result creates a new run's files.

        Raises:
            RunFileError: The folder cannot be written, or holds a run of another configuration.
        """
        self.folder = folder
        self._info = info
        self.done: set[EpisodeKey] = set()
        """Episodes that the folder already holds."""
        self._scene_digests: dict[str, str] = {}
        try:
            if not folder.exists():
                folder.mkdir(parents=True)
                folder.rmdir()  # this shows that it can be written; a run without results leaves no folder
            if (folder / "run.json").exists():
                self._require_same_run(read_run_info(folder), info)
                for name in self._names:
                    _cut_incomplete_tail(folder / name)
                self._note_done()
                _cut_unfinished_turns(folder / CHAT_FILE, self.done)
        except OSError as error:
            raise self._unwritable(error) from None

    def add_episode(self, run: EpisodeRun, *, chat: Transcript = NO_CHAT) -> None:
        """Appends one block, after what its agent asked of a chat model; both are on disk when this returns.

        Raises:
            RunFileError: The folder cannot be written, or holds episodes on another version of this scene.
        """
        self._require_same_scene(run.key, run.end.measures)
        self._add_chat(chat)
        self._append("steps.jsonl", (run.start, *run.steps, run.end))
        self.done.add(run.key)

    def add_answers(self, answers: Sequence[Answer], *, chat: Transcript = NO_CHAT) -> None:
        """Appends one line each, after what was asked of a chat model for them; all is on disk when this returns.

        Raises:
            RunFileError: The folder cannot be written.
        """
        self._add_chat(chat)
        self._append("answers.jsonl", answers)
        self.done.update(answer.key for answer in answers)

    def add_reported(self, figures: Sequence[Reported]) -> None:
        """Appends one line each; they are on disk when this returns.

        Raises:
            RunFileError: The folder cannot be written.
        """
        self._append("reported.jsonl", figures)
        self.done.update(item.key for item in figures)

    def _note_done(self) -> None:
        """Notes what the folder holds already."""
        run = read_run(self.folder, with_reported=True)
        self.done |= {item.key for item in (*run.episodes, *run.answers, *run.reported)}
        for episode in run.episodes:
            self._require_same_scene(episode.key, episode.end.measures)

    def _add_chat(self, chat: Transcript) -> None:
        try:
            for name, png in chat.pictures.items():
                if not (self.folder / name).exists():
                    write_whole(self.folder / name, png)
        except OSError as error:
            raise self._unwritable(error) from None
        if chat.turns:
            self._append(CHAT_FILE, chat.turns)

    def _append(self, name: str, lines: Sequence[BaseModel]) -> None:
        text = "".join(line.model_dump_json() + "\n" for line in lines)
        try:
            if not (self.folder / "run.json").exists():
                write_whole(self.folder / "run.json", self._info.model_dump_json(indent=2) + "\n")
            append_whole(self.folder / name, text)
        except OSError as error:
            raise self._unwritable(error) from None

    def _unwritable(self, error: OSError) -> RunFileError:
        return RunFileError(
            f"{self.folder}: cannot be written ({error}); expected a folder with space that you can write. "
            "Give another --out, or make room and run again: finished episodes are kept."
        )

    def _require_same_run(self, found: RunInfo, wanted: RunInfo) -> None:
        for field in ("who", "condition", "scene_kind", "dataset_digest", "seed", "config", "made_for", "labels"):
            was, now = getattr(found, field), getattr(wanted, field)
            if isinstance(was, dict):
                was, now = _differing(was, now)
            if isinstance(was, dict) and was.keys() | now.keys() and all(key.endswith("_code") for key in was | now):
                names = ", ".join(sorted(key.removesuffix("_code") for key in was | now))
                raise RunFileError(
                    f"{self.folder / 'run.json'}: the run was made with other code of your {names}; expected the same "
                    "code. Give --label NAME to keep both versions in one table, or another --run-id or --out."
                )
            if was != now:
                raise RunFileError(
                    f"{self.folder / 'run.json'}: {field} is {was!r}, this run has {now!r}; "
                    "expected the same to resume. Give another --out or --run-id."
                )

    def _require_same_scene(self, key: EpisodeKey, measures: Measures | None) -> None:
        """Refuses distances on another version of the home; a run without measures does not say its version."""
        if measures is None:
            return
        scene, now = key.scene, measures.scene_digest
        was = self._scene_digests.setdefault(scene, now)
        if was != now:
            raise RunFileError(
                f"{self.folder / self._names[0]}: scene_digest of {scene} is {was[:12]!r}, {key} has {now[:12]!r}; "
                "expected one version of the home per run. Give another --out or --run-id."
            )


def _differing(was: dict[str, Any], now: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """The entries of each that are missing or different in the other."""
    return (
        {key: value for key, value in was.items() if key not in now or now[key] != value},
        {key: value for key, value in now.items() if key not in was or was[key] != value},
    )


def _cut_incomplete_tail(path: Path) -> None:
    """Drops lines after the last complete block or answer, which a kill in the middle of a write left."""
    if not path.is_file():
        return
    lines = path.read_text(encoding="utf-8", errors="replace").splitlines(keepends=True)
    whole = len(lines)
    while whole and not (lines[whole - 1].endswith("\n") and _closes_a_block(lines[whole - 1])):
        whole -= 1
    if whole < len(lines):
        write_whole(path, "".join(lines[:whole]))


def _cut_unfinished_turns(path: Path, done: Container[object]) -> None:
    """Drops the turns of episodes that a kill left without a result: they are asked again.

    Raises:
        RunFileError: A line is damaged; an incomplete last one is dropped.
    """
    if not path.is_file():
        return
    lines = path.read_bytes().splitlines(keepends=True)
    kept = [
        line
        for number, line in enumerate(lines, start=1)
        if line.endswith(b"\n") and turn_from_line(line, where=f"{path}:{number}").key in done
    ]
    if len(kept) < len(lines):
        write_whole(path, b"".join(kept))


def _closes_a_block(line: str) -> bool:
    try:
        raw = json.loads(line)
    except (ValueError, RecursionError):
        return False
    return isinstance(raw, dict) and raw.get("kind") in ("end", "answer", "reported", "sequence_end")
