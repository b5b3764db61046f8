"""Appends finished sequences to a run folder, so that a kill loses only unfinished ones."""

from typing import ClassVar

from sim.tasks.chat_turns import NO_CHAT, Transcript
from sim.tasks.run_writer import RunWriter

from .runs import SEQUENCES_FILE, SequenceRun, read_sequence_runs


class SequenceWriter(RunWriter):
    """A `RunWriter` whose results are sequences."""

    _names: ClassVar[tuple[str, ...]] = (SEQUENCES_FILE,)

    def add_sequence(self, run: SequenceRun, *, chat: Transcript = NO_CHAT) -> None:
        """Appends one block, after what was asked of a chat model for it; both are on disk when this returns.

        Raises:
            RunFileError: The folder cannot be written, or holds sequences on another version of this home.
        """
        self._require_one_home(run)
        self._add_chat(chat)
        self._append(SEQUENCES_FILE, (run.start, *run.steps, run.end))
        self.done.add(run.key)

    def _note_done(self) -> None:
        for run in read_sequence_runs(self.folder):
            self._require_one_home(run)
            self.done.add(run.key)

    def _require_one_home(self, run: SequenceRun) -> None:
        for search in run.end.searches:
            self._require_same_scene(run.key, search.measures)
