"""Secrets and ids: personal tokens (only their hash is stored) and ids that the server makes up."""

import hashlib
import hmac
import secrets
import time

_CROCKFORD = "0123456789ABCDEFGHJKMNPQRSTVWXYZ"
_TOKEN_BYTES = 16
"""128 bit (HUMAN_STUDY.md, section 7)."""


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
