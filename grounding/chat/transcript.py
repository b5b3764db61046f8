"""Keeps what is asked of an endpoint, episode by episode, for the run folder."""

from collections.abc import Sequence

from sim.tasks.chat_turns import ChatTurn, PicturePart, TextPart, Transcript, picture_name
from sim.types import EpisodeKey

from .endpoint import Endpoint, Reply
from .protocol import Part


class RecordedChat:
    """A `Chat` that asks an endpoint and remembers each question until `take`."""

    def __init__(self, endpoint: Endpoint) -> None:
        """Starts without questions."""
        self._endpoint = endpoint
        self._asked: list[tuple[str, Reply]] = []
        self._sent: set[str] = set()

    @property
    def name(self) -> str:
        """The model's name."""
        return self._endpoint.name

    def ask(self, system: str, parts: Sequence[Part], *, is_json: bool = False) -> str:
        """As the protocol says; a question without an answer is remembered too.

        Raises:
            NoAnswer: None came.
            AgentError: The server refuses the key or the model, or the budget is spent.
        """
        reply = self._endpoint.reply(system, parts, is_json=is_json)
        self._asked.append((system, reply))
        if reply.problem is not None:
            raise reply.problem
        return reply.answer

    def take(self, key: EpisodeKey) -> Transcript:
        """The questions since the last call, as those of this episode.

        It holds each picture once for all calls: the transcripts of one process reach the run folder in order.
        """
        turns = tuple(self._turn(key, number, *asked) for number, asked in enumerate(self._asked, start=1))
        parts = [part for _, reply in self._asked for part in reply.sent if not isinstance(part, str)]
        fresh = {name: png for png in parts if (name := picture_name(png)) not in self._sent}
        self._sent |= fresh.keys()
        self._asked.clear()
        return Transcript(turns, fresh)

    def _turn(self, key: EpisodeKey, number: int, system: str, reply: Reply) -> ChatTurn:
        return ChatTurn(
            split=key.split,
            scene=key.scene,
            episode_id=key.episode_id,
            call=number,
            model=self.name,
            system=system,
            parts=tuple(
                TextPart(text=part) if isinstance(part, str) else PicturePart(picture=picture_name(part))
                for part in reply.sent
            ),
            answer=reply.answer,
            problem=str(reply.problem or ""),
            cached=reply.used.cached > 0,
            prompt_tokens=reply.used.prompt_tokens,
            completion_tokens=reply.used.completion_tokens,
            retries=reply.used.retries,
        )
