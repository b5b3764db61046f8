"""The local socket between a viser worker and the gateway's store: typed requests, answered after commit.

One JSON object per line. Requests carry a number, so that several threads of a worker can wait at once.
"""

import contextlib
import itertools
import socket
import threading
import traceback
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import msgspec
from pydantic import TypeAdapter

from human_study.journey import AssignedTrial, Person, Stage
from human_study.store.store import StudyStore, SupersededError, Trial, TrialEndedError
from human_study.store.writer import StoreFullError
from human_study.trial.events import Event, event_from_json, event_to_json
from human_study.trial.outcome import Outcome
from sim.errors import StudyError

from .worker_door import WorkerDoor

_ERRORS: dict[str, type[StudyError]] = {
    kind.__name__: kind for kind in (StudyError, StoreFullError, SupersededError, TrialEndedError)
}
WARM = 0
"""Number of a reply without a request: the scene of a home to open before it is needed."""
_OUTCOME: TypeAdapter[Outcome] = TypeAdapter(Outcome)


class Call(msgspec.Struct, frozen=True):
    """A request on the wire: the name of one of `StoreLink`'s methods, and its arguments as JSON."""

    number: int
    name: str
    arguments: list[Any]


class Reply(msgspec.Struct, frozen=True):
    """The answer to a request: a value as JSON, or an error."""

    number: int
    value: msgspec.Raw = msgspec.Raw(b"null")
    error: str | None = None
    """Class name of a StudyError."""
    message: str = ""


class StoreLink:
    """The worker's end: the store's methods, each blocking until the gateway has committed."""

    def __init__(self, connection: socket.socket) -> None:
        """Starts listening for answers; `is_closed` is set when the gateway is gone."""
        self._connection = connection
        self._waiting: dict[int, Future[Reply]] = {}
        self._numbers = itertools.count(1)
        self._lock = threading.Lock()
        self.is_closed = threading.Event()
        self.on_warm: Callable[[str], object] = lambda _: None
        """Called with the scene of a home that somebody will soon need."""
        threading.Thread(target=self._listen, daemon=True, name="store-link").start()

    def tell_ready(self, door: WorkerDoor) -> None:
        """Tells the gateway where the worker listens, and its secret."""
        self._ask("tell_ready", door.port, door.secret)

    def tell_failed(self, message: str) -> None:
        """Tells the gateway why the worker cannot start."""
        self._ask("tell_failed", message)

    def code_of_ticket(self, ticket: str) -> str | None:
        """Code of the participant who holds a ticket; None if nobody does."""
        return self._ask("code_of_ticket", ticket, kind=str | None)

    def person(self, code: str) -> Person:
        """The participant's place in the study."""
        return self._ask("person", code, kind=Person)

    def enter_stage(self, code: str, stage: Stage, detail: dict[str, Any] | None = None) -> None:
        """`StudyStore.enter_stage`."""
        self._ask("enter_stage", code, stage, detail or {})

    def withdraw(self, code: str) -> None:
        """`StudyStore.withdraw`."""
        self._ask("withdraw", code)

    def next_trial(self, code: str) -> AssignedTrial | None:
        """The trial that is due; None when there is nothing (more) to do (`StudyStore.next_trial`)."""
        return self._ask("next_trial", code, kind=AssignedTrial | None)

    def open_trial(self, code: str, order_no: int, *, connection: int = 0) -> Trial:
        """`StudyStore.open_trial`."""
        return self._ask("open_trial", code, order_no, connection, kind=Trial)

    def events(self, trial_id: str) -> list[Event]:
        """All stored events of a trial, in order."""
        return [event_from_json(line) for line in self._ask("events", trial_id, kind=list[str])]

    def append_many(self, trial_id: str, epoch: int, events: Sequence[Event]) -> None:
        """`StudyStore.append_many`; the events are on disk when this returns."""
        self._ask("append_many", trial_id, epoch, [event_to_json(event) for event in events])

    def finish_trial(self, trial_id: str, outcome: Outcome) -> None:
        """`StudyStore.finish_trial`; the outcome is on disk when this returns."""
        self._ask("finish_trial", trial_id, outcome.model_dump_json())

    def _ask(self, name: str, *arguments: object, kind: Any = None) -> Any:
        """The gateway's answer to a call, as a `kind`; raises the StudyError that the store raised."""
        number = next(self._numbers)
        answer: Future[Reply] = Future()
        self._waiting[number] = answer
        try:
            with self._lock:
                self._connection.sendall(msgspec.json.encode(Call(number, name, list(arguments))) + b"\n")
        except OSError:
            raise self._gone() from None
        if self.is_closed.is_set() and not answer.done():
            raise self._gone()
        reply = answer.result()
        if reply.error is not None:
            raise _ERRORS.get(reply.error, StudyError)(reply.message)
        return msgspec.json.decode(reply.value, type=kind)

    def _listen(self) -> None:
        try:
            for line in self._connection.makefile("rb"):
                reply = msgspec.json.decode(line, type=Reply)
                if reply.number == WARM:
                    self.on_warm(msgspec.json.decode(reply.value, type=str))
                    continue
                self._waiting.pop(reply.number).set_result(reply)
        except (OSError, msgspec.MsgspecError):
            pass  # the gateway is gone, perhaps in the middle of a line
        finally:
            self.is_closed.set()
            for answer in list(self._waiting.values()):
                answer.set_exception(self._gone())

    def _gone(self) -> StudyError:
        return StudyError(
            "the gateway has ended; expected it to run. Start the study again: nothing acknowledged is lost."
        )


class StoreService:
    """The gateway's end: answers one worker's requests from the store."""

    def __init__(
        self,
        connection: socket.socket,
        store: StudyStore,
        *,
        code_of_ticket: Callable[[str], str | None],
        client_profile: Callable[[str], dict[str, Any] | None],
        on_end: Callable[[], None],
    ) -> None:
        """Starts answering.

        Args:
            connection: Our end of the socket pair.
            store: Owned by the gateway.
            code_of_ticket: Returns the participant who holds a ticket.
            client_profile: Returns the coarse profile of a participant's browser, which is stored with each sitting;
                None = not known.
            on_end: Called once when the worker has ended, for any reason.
        """
        self._connection = connection
        self._store = store
        self._code_of_ticket = code_of_ticket
        self._client_profile = client_profile
        self._on_end = on_end
        self._lock = threading.Lock()
        self._pool = ThreadPoolExecutor(8, thread_name_prefix="store-service")
        self.started: Future[WorkerDoor] = Future()
        """The worker's door, or StudyError when it cannot start or ends before it is ready."""
        threading.Thread(target=self._listen, daemon=True, name="store-service").start()

    def close(self) -> None:
        """Ends the connection; the worker ends by itself."""
        with contextlib.suppress(OSError):  # the worker may be gone already
            self._connection.shutdown(socket.SHUT_RDWR)  # close alone waits for the listening thread's file
        self._connection.close()
        self._pool.shutdown(wait=False, cancel_futures=True)

    def warm(self, scene: str) -> None:
        """Asks the worker to open a home that somebody will soon need; returns at once."""
        self._send(Reply(WARM, msgspec.Raw(msgspec.json.encode(scene))))

    def _send(self, reply: Reply) -> None:
        with self._lock, contextlib.suppress(OSError):  # a worker that is gone needs no answer
            self._connection.sendall(msgspec.json.encode(reply) + b"\n")

    def _listen(self) -> None:
        try:
            for line in self._connection.makefile("rb"):
                self._pool.submit(self._answer, msgspec.json.decode(line, type=Call))
        except (OSError, ValueError, RuntimeError, msgspec.MsgspecError):
            pass  # closed by us, or the worker ended in the middle of a line
        finally:
            if not self.started.done():
                self.started.set_exception(
                    StudyError("the viser worker ended before it was ready; see its message above.")
                )
            self._on_end()

    def _answer(self, call: Call) -> None:
        try:
            reply = Reply(call.number, msgspec.Raw(msgspec.json.encode(self._value(call))))
        except StudyError as error:
            reply = Reply(call.number, error=type(error).__name__, message=str(error))
        except Exception as error:  # a live session's door: the other end waits for an answer
            traceback.print_exc()
            reply = Reply(call.number, error="StudyError", message=f"the store failed: {error!r}")
        self._send(reply)

    def _value(self, call: Call) -> object:
        """The answer to one of the calls that a worker may make."""
        store = self._store
        match call.name, call.arguments:
            case "tell_ready", [port, secret]:
                self.started.set_result(WorkerDoor(port, secret))
            case "tell_failed", [message]:
                self.started.set_exception(StudyError(message))
            case "code_of_ticket", [ticket]:
                return self._code_of_ticket(ticket)
            case "person", [code]:
                return store.participant(code)
            case "enter_stage", [code, stage, detail]:
                profile = self._client_profile(code) if stage == "sitting_started" else None
                store.enter_stage(code, stage, {**detail, "client": profile} if profile else detail)
            case "withdraw", [code]:
                store.withdraw(code)
            case "next_trial", [code]:
                return store.next_trial(code)
            case "open_trial", [code, order_no, connection]:
                return store.open_trial(code, order_no, connection=connection)
            case "events", [trial_id]:
                return [event_to_json(stored.event) for stored in store.events(trial_id)]
            case "append_many", [trial_id, epoch, lines]:
                store.append_many(trial_id, epoch, [event_from_json(line) for line in lines])
            case "finish_trial", [trial_id, outcome]:
                store.finish_trial(trial_id, _OUTCOME.validate_json(outcome))
            case _:
                raise StudyError(f"{call.name}: is no call of a worker; expected one of StoreLink.")
        return None
