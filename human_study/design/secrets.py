"""Secrets and ids: personal tokens (the store keeps only their hash), the file that holds them, ids of the server."""

import base64
import hashlib
import hmac
import json
import secrets
import time
from collections.abc import Sequence
from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError

from sim.errors import StudyError, line_from_validation_error

from ..private_files import write_private

_CROCKFORD = "0123456789ABCDEFGHJKMNPQRSTVWXYZ"
_TOKEN_BYTES = 16
"""128 bit (HUMAN_STUDY.md, section 7)."""
SECRETS_FILE = "secrets.json"


class StudySecrets(BaseModel):
    """`secrets.json`."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    tokens: dict[str, str] = {}
    """Personal token of each participant, as plain text."""
    key: str = ""
    """Key for all keyed hashes of this study: 32 bytes as base64."""

    @property
    def key_bytes(self) -> bytes:
        """The study's key."""
        return base64.b64decode(self.key)


def load_secrets(folder: Path) -> StudySecrets:
    """The study's secrets; empty where there are none yet.

    Raises:
        StudyError: The file is damaged.
    """
    path = folder / SECRETS_FILE
    try:
        return StudySecrets.model_validate_json(path.read_bytes(), strict=True)
    except FileNotFoundError:
        return StudySecrets()
    except OSError as error:
        raise StudyError(f"{path}: cannot be read ({error.strerror}); expected the study's secrets.") from None
    except ValidationError as error:
        raise StudyError(line_from_validation_error(path, error, advice="Restore it from a copy.")) from None


def make_secrets(folder: Path, codes: Sequence[str]) -> StudySecrets:
    """The study's secrets with a token for each participant, on disk when this returns; existing tokens stay.

    Raises:
        StudyError: The file is damaged or cannot be written.
    """
    found = load_secrets(folder)
    tokens = found.tokens | {code: new_token() for code in codes if code not in found.tokens}
    key = found.key or base64.b64encode(secrets.token_bytes(32)).decode()
    made = StudySecrets(tokens=tokens, key=key)
    if made != found:
        write_private(folder / SECRETS_FILE, json.dumps(made.model_dump(), indent=1) + "\n")
    return made


def new_token() -> str:
    """A fresh personal token of 128 random bits, as 22 characters that are safe in a link."""
    return secrets.token_urlsafe(_TOKEN_BYTES)


def token_hash(token: str) -> str:
    """sha256 of a token, 64 hex digits: all that the store keeps of it."""
    return hashlib.sha256(token.encode()).hexdigest()


def token_matches(token: str, stored_hash: str) -> bool:
    """Whether `stored_hash` is this token's hash; takes the same time wherever they differ."""
    return hmac.compare_digest(token_hash(token), stored_hash)


def new_id() -> str:
    """A ULID: 26 characters that sort by the millisecond they were made in and cannot be guessed."""
    number = (time.time_ns() // 1_000_000) << 80 | secrets.randbits(80)
    return "".join(_CROCKFORD[number >> shift & 31] for shift in range(125, -1, -5))
