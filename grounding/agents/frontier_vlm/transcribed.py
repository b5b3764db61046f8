"""`frontier-vlm` for runs: the agent judged by a recorded chat model, and what it asked in an episode.

`RecordedChat` -> `ChatJudge` of each episode -> `Transcript` with the answers that could not be used -> the run folder.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from grounding.perception.protocol import Perception
from sim.tasks.chat_turns import Transcript
from sim.tasks.observers import Insight
from sim.types import Action, Camera, EpisodeKey, Observation, Task

from ...chat.transcript import RecordedChat
from .agent import JudgedFrontierAgent
from .chat_judge import ChatJudge


class TranscribedAgent:
    """A `JudgedFrontierAgent` with a `ChatJudge` that the runner asks for its transcript (`Converses`)."""

    def __init__(self, perception: Perception, goal_text: Callable[[Task], str], chat: RecordedChat) -> None:
        """Asks nothing yet; the arguments are those of `JudgedFrontierAgent`."""
        self._chat, self._judge = chat, ChatJudge(chat)
        self._agent = JudgedFrontierAgent(perception, goal_text, judge=self._new_judge)

    def reset(self, task: Task, camera: Camera, *, seed: int, keep_memory: bool = False) -> None:
        """As the agent does."""
        self._agent.reset(task, camera, seed=seed, keep_memory=keep_memory)

    def carry(self, T_map_start: NDArray[np.float64]) -> None:
        """As the agent does."""
        self._agent.carry(T_map_start)

    def act(self, observation: Observation) -> Action:
        """As the agent does."""
        return self._agent.act(observation)

    def insight(self) -> Insight:
        """As the agent does."""
        return self._agent.insight()

    def transcript(self, key: EpisodeKey) -> Transcript:
        """The questions since the last call; those whose answers could not be used say why."""
        asked, unusable = self._chat.take(key), self._judge.unusable
        turns = (turn.model_copy(update={"problem": unusable.get(turn.call, "")}) for turn in asked.turns)
        return Transcript(tuple(turns), asked.pictures)

    def _new_judge(self) -> ChatJudge:
        self._judge = ChatJudge(self._chat)
        return self._judge
