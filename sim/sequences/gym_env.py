"""Home sequences as a Gymnasium environment: `PanGymEnv` with searches that follow each other, messages, and FOUND.

from sim.episodes.dataset import PersonalDataset
from sim.episodes.sequence_files import SequenceSet
from sim.sequences.gym_env import SequenceGymEnv

env = SequenceGymEnv(PersonalDataset("data/split"), SequenceSet("data/sequences/ours"), scenes_dir=Path("hm3d/val"))
observation, info = env.reset(seed=1)  # as in PAN; "query" is the present one, "message" is news of this step or ""
observation, reward, terminated, truncated, info = env.step(6)  # 6 found; 0-5 as in PAN, and 0 stops everything
info["search"]  # where a search has just ended: {"index": 0, "reason": "found"}
observation, info = env.reset(options={"episode": "hard/TEEsavR23oF/0"})  # split/scene/sequence
"""

import dataclasses
from typing import Any

from gymnasium import spaces

from sim.episodes.dataset import PersonalDataset
from sim.episodes.schema import Episode
from sim.episodes.sequence_files import HomeSequence, SequenceSet
from sim.errors import DatasetError
from sim.tasks.gym_env import PanGymEnv, text_space
from sim.types import SEQUENCE7, Action, EpisodeKey, Observation, Prompt, Split

from .scoring import run_from_sequence_env, score_search, search_reason
from .searches import prompts_of, search_episode, sequence_key


class SequenceGymEnv(PanGymEnv):
    """Home sequences of a set, one after the other. An "episode" of Gymnasium is a whole sequence.

    `terminated` comes with STOP and at the end of the last search, also where its steps have run out; nothing is
    truncated. The reward is 1 for a search that ends with success under rule `paper` (where all right objects are
    wanted: each marked once, and nothing else), else 0. `info` gives the truth, `sequence_end` with each search scored,
    only after the end.
    """

    def __init__(
        self,
        dataset: PersonalDataset,
        sequences: SequenceSet,
        *,
        actions: tuple[Action, ...] = SEQUENCE7,
        **options: Any,  # PanGymEnv lists and checks them
    ) -> None:
        """Reads the sequences; opens no scene.

        Args:
            dataset: Source of the homes.
            sequences: Source of the sequences.
            actions: The action of each number, in order.
            options: Those of `PanGymEnv` but `reward`; `max_steps` are those of each search.

        Raises:
            DatasetError: No sequence is left, a scene is unknown, or a file is damaged.
        """
        self._set = sequences
        self._sequences: dict[EpisodeKey, HomeSequence] = {}
        self._query = ""
        super().__init__(dataset, actions=actions, reward="success", **options)

    def _read(self, splits: tuple[Split, ...], scenes: tuple[str, ...] | None) -> dict[EpisodeKey, Episode]:
        """The first search of each sequence as an episode with the sequence's name."""
        found = {sequence_key(sequence): sequence for sequence in self._set.sequences(scenes=scenes)}
        self._sequences = {key: sequence for key, sequence in found.items() if key.split in splits}
        if not self._sequences:
            raise DatasetError(
                f"{self._set.root}: found no sequence in splits {list(splits)} of scenes "
                f"{list(scenes or self._set.files)}; expected at least one. Name other splits or scenes."
            )
        return {
            key: dataclasses.replace(search_episode(sequence, 0), key=key) for key, sequence in self._sequences.items()
        }

    def _prompts(self) -> tuple[Prompt, ...]:
        assert self._episode is not None, "reset chooses the episode first"
        return prompts_of(self._sequences[self._episode.key])

    def _ends(self) -> tuple[bool, bool]:
        return self._running()[1].is_over, False

    def _spaces(self) -> spaces.Dict:
        told = [prompt for sequence in self._sequences.values() for prompt in prompts_of(sequence)]
        return spaces.Dict(
            {
                **super()._spaces().spaces,
                "message": text_space(["", *(prompt.message for prompt in told if prompt.message)]),
                "query": text_space([prompt.query for prompt in told]),
            }
        )

    def _observation(self, sensed: Observation) -> dict[str, Any]:
        self._query = sensed.query or self._query  # not the next one after STOP
        return {**super()._observation(sensed), "message": sensed.message or "", "query": self._query}

    def _info(self) -> dict[str, Any]:
        info, index = super()._info(), self._ended()
        if index is not None:
            env = self._running()[1]
            begin, end = (0, *env.search_ends)[index : index + 2]
            is_for_all = self._prompts()[index].is_for_all
            reason = search_reason(env.steps[begin:end], is_for_all=is_for_all)
            info["search"] = {"index": index, "reason": reason}
        return info

    def _scored(self) -> dict[str, Any]:
        episode, env = self._running()
        scene = self._opened(episode.key.scene)
        sequence = self._sequences[episode.key]
        run = run_from_sequence_env(sequence, env, scene_digest=scene.digest, navigation=scene.navigation)
        return {"sequence_end": run.end.model_dump()}

    def _reward_of(self, info: dict[str, Any]) -> float:
        index = self._ended()
        if index is None:
            return 0.0
        episode, env = self._running()
        scene, sequence = self._opened(episode.key.scene), self._sequences[episode.key]
        end = score_search(sequence, index, env, scene_digest=scene.digest, navigation=scene.navigation)
        return float(end.succeeds("paper") or False)

    def _ended(self) -> int | None:
        """Index of the search that the last action has ended; None = it has not ended one."""
        env = self._running()[1]
        ends = env.search_ends
        return len(ends) - 1 if ends and ends[-1] == len(env.steps) else None
