"""Admits participants: personal tokens, the open link, Prolific's parameters, and tickets for websockets.

Only an HMAC of a platform's id, made with the study's key, reaches the database. The id itself goes to `pay.db`, and
only when the study file asks for it.
"""

import contextlib
import hashlib
import hmac
import json
import os
import secrets
import sqlite3
import threading
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any

import msgspec

from human_study.design.study import StudyConfig
from human_study.private_files import write_private
from human_study.store.store import StudyStore
from sim.errors import StudyError

SESSIONS_FILE = "sessions.json"
"""File with hashes of tickets, so that open pages go on after a restart; readable by the owner only, never exported."""
PAY_FILE = "pay.db"
"""File with platform ids in clear text for paying people; readable by the owner only, never exported."""
PlatformId = Annotated[str, msgspec.Meta(pattern=r"\A[A-Za-z0-9]{4,64}\Z")]


class DeviceProfile(msgspec.Struct, frozen=True):
    """A coarse profile of a participant's browser."""

    webgl2: bool
    width: Annotated[int, msgspec.Meta(ge=0, le=100_000)]
    """Width of the window, pixels, rounded to hundreds."""
    height: Annotated[int, msgspec.Meta(ge=0, le=100_000)]
    dpr: Annotated[float, msgspec.Meta(gt=0, le=16)]
    """Device pixels per pixel, rounded to quarters."""
    touch: bool

    def coarse(self) -> "DeviceProfile":
        """The profile rounded again, because a browser may send any numbers."""
        width, height = (round(pixels / 100) * 100 for pixels in (self.width, self.height))
        return DeviceProfile(self.webgl2, width, height, round(self.dpr * 4) / 4, self.touch)


class Arrival(msgspec.Struct, frozen=True):
    """Somebody on the open link, with Prolific's parameters if they are given."""

    PROLIFIC_PID: PlatformId | None = None
    STUDY_ID: PlatformId | None = None
    SESSION_ID: PlatformId | None = None


class Ticket(msgspec.Struct, frozen=True):
    """Admission of one browser session to the websocket."""

    code: str
    """Public code of the participant."""
    session_hash: str
    """sha256 of the cookie that belongs to the ticket."""
    profile: DeviceProfile | None = None

    def admits(self, cookie: str) -> bool:
        """Whether this is the ticket's own cookie; the time of the comparison does not show where they differ."""
        return hmac.compare_digest(_sha256(cookie), self.session_hash)


class Tickets:
    """The tickets that admit participants to a websocket. A participant's newest ticket revokes the older ones."""

    def __init__(self, folder: Path | None = None) -> None:
        """Reads the tickets of the study's last run from `folder`; None = tickets are kept in memory only.

        Raises:
            StudyError: The file of the last run is damaged.
        """
        self._path = folder / SESSIONS_FILE if folder is not None else None
        self._lock = threading.Lock()
        self._by_hash: dict[str, Ticket] = {}
        if self._path is not None and self._path.exists():
            try:
                self._by_hash = msgspec.json.decode(self._path.read_bytes(), type=dict[str, Ticket])
            except (OSError, msgspec.MsgspecError) as error:
                raise StudyError(
                    f"{self._path}: cannot be read ({error}); expected the tickets of open pages. "
                    "Delete the file: everybody then opens the personal link once more."
                ) from None

    def issue(self, code: str, profile: DeviceProfile | None = None) -> tuple[str, str]:
        """A new session id and ticket id for a participant, valid also after a restart. Blocks until they are kept."""
        session_id, ticket_id = secrets.token_urlsafe(16), secrets.token_urlsafe(16)
        with self._lock:
            kept = {known: ticket for known, ticket in self._by_hash.items() if ticket.code != code}
            self._keep({**kept, _sha256(ticket_id): Ticket(code, _sha256(session_id), profile)})
        return session_id, ticket_id

    def find(self, ticket_id: str) -> Ticket | None:
        """The ticket; None if it was never issued or is revoked."""
        return self._by_hash.get(_sha256(ticket_id))

    def code_of(self, ticket_id: str) -> str | None:
        """Code of the participant who holds the ticket; None for an unknown ticket."""
        ticket = self.find(ticket_id)
        return ticket.code if ticket is not None else None

    def client_profile(self, code: str) -> dict[str, Any] | None:
        """The profile of the participant's browser as JSON; None if the browser sent none."""
        profiles = [ticket.profile for ticket in list(self._by_hash.values()) if ticket.code == code]
        return msgspec.to_builtins(profiles[0]) if profiles and profiles[0] is not None else None

    def revoke(self, code: str) -> None:
        """Revokes all tickets of the participant: they open no further websocket."""
        with self._lock:
            self._keep({known: ticket for known, ticket in self._by_hash.items() if ticket.code != code})

    def _keep(self, tickets: dict[str, Ticket]) -> None:
        if self._path is not None:
            write_private(self._path, json.dumps(msgspec.to_builtins(tickets), indent=1) + "\n")
        self._by_hash = tickets


class PayFile:
    """Platform ids of the people to pay, apart from the study's data."""

    def __init__(self, folder: Path) -> None:
        """Takes the study's folder; the file is made when the first id is kept."""
        self._path = folder / PAY_FILE

    def keep(self, code: str, arrival: Arrival) -> None:
        """Keeps a participant's platform id, once; it is on disk when this returns.

        Raises:
            StudyError: The file cannot be written.
        """
        with self._database("written", "Free space or correct the folder's permissions.") as database:
            database.execute("PRAGMA synchronous=FULL")
            database.execute(
                "CREATE TABLE IF NOT EXISTS payee (code TEXT PRIMARY KEY, platform_id TEXT, study_id TEXT, "
                "session_id TEXT) STRICT"
            )
            row = (code, arrival.PROLIFIC_PID, arrival.STUDY_ID, arrival.SESSION_ID)
            database.execute("INSERT OR IGNORE INTO payee VALUES (?, ?, ?, ?)", row)

    def purge(self) -> int:
        """Deletes all ids, after everybody is paid; returns their number. A person who comes back later is kept again.

        Raises:
            StudyError: The file is damaged or cannot be deleted.
        """
        if not self._path.exists():
            return 0
        with self._database("purged", "Delete it by hand.") as database:
            database.execute("PRAGMA secure_delete=ON")
            num_ids = database.execute("DELETE FROM payee").rowcount
            database.close()
            self._path.unlink()
        return num_ids

    @contextlib.contextmanager
    def _database(self, done: str, advice: str) -> Iterator[sqlite3.Connection]:
        """The open file, readable by the owner only; errors become a StudyError with this advice."""
        try:
            os.close(os.open(self._path, os.O_CREAT | os.O_WRONLY, 0o600))
            with contextlib.closing(sqlite3.connect(self._path, isolation_level=None)) as database:
                yield database
        except (OSError, sqlite3.Error) as error:
            raise StudyError(
                f"{self._path}: cannot be {done} ({error}); expected the file of people to pay. {advice}"
            ) from None


class Admission:
    """Turns a token or an arrival into a participant."""

    def __init__(
        self,
        people: StudyStore,
        config: StudyConfig,
        *,
        token_of_code: Mapping[str, str],
        platform_key: bytes,
        pay_file: PayFile,
    ) -> None:
        """Takes the people of one study.

        Args:
            people: The store.
            config: The study: it says how people come, and whether platform ids are kept.
            token_of_code: Personal token of each participant.
            platform_key: The study's own key for platform ids.
            pay_file: The file for platform ids; filled only when the study file asks for them.
        """
        self._people, self._config = people, config
        self._token_of_code, self._key, self._pay_file = token_of_code, platform_key, pay_file

    @property
    def has_open_link(self) -> bool:
        """Whether people may come without a personal link."""
        return self._config.recruit.kind != "local"

    @property
    def needs_platform_id(self) -> bool:
        """Whether people on the open link must bring Prolific's parameters."""
        return self._config.recruit.kind == "prolific"

    def code_of_token(self, token: str) -> str | None:
        """Code of the participant with this personal token; None if the token is unknown."""
        return self._people.code_of_token(token)

    def join(self, arrival: Arrival) -> str | None:
        """A personal token for somebody on the open link, the same for the same person; None = the study is full.

        Raises:
            StudyError: The store or the file for paying people cannot be written.
        """
        asks = self._config.privacy.platform_id == "hmac"
        person_id = arrival.PROLIFIC_PID if asks or self.needs_platform_id else None
        ext_hash = hmac.new(self._key, person_id.encode(), hashlib.sha256).hexdigest() if person_id else None
        code = self._people.claim_person(ext_hash)
        if code is None:
            return None
        if asks and person_id is not None:
            self._pay_file.keep(code, arrival)
        return self._token_of_code[code]


def _sha256(text: str) -> str:
    return hashlib.sha256(text.encode("utf-8", "surrogatepass")).hexdigest()
