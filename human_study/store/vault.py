"""Encrypts each participant's data with a key of its own, so that deleting the key deletes the data everywhere.

The keys are in `keys.json` beside the database, never in backups or exports. A hash chain over the ciphertext still
verifies after a key is gone.
"""

import base64
import json
import secrets
from pathlib import Path

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import AESGCM

from sim.errors import StudyError

from ..private_files import write_private

KEYS_FILE = "keys.json"
_NONCE_BYTES = 12
"""Length of the random nonce before each ciphertext, bytes."""


class Vault:
    """The keys of one study's participants."""

    def __init__(self, folder: Path) -> None:
        """Reads the existing keys of a study's folder; raises StudyError where the file is damaged."""
        self._path = folder / KEYS_FILE
        self._ciphers: dict[str, AESGCM] = {}
        self._keys: dict[str, str | None] = {}
        try:
            self._keys = json.loads(self._path.read_bytes()) if self._path.exists() else {}
            self._ciphers = {code: AESGCM(base64.b64decode(key)) for code, key in self._keys.items() if key}
        except (OSError, ValueError, TypeError, AttributeError, RecursionError) as error:
            raise StudyError(
                f"{self._path}: cannot be read ({error}); expected the keys of the participants. Restore the file: "
                "without it nothing that they did can be read."
            ) from None

    def has_key(self, code: str) -> bool:
        """Whether the participant's data can be read."""
        return code in self._ciphers

    def is_shredded(self, code: str) -> bool:
        """Whether the participant's key was deleted for good; a missing key without the mark was lost."""
        return code in self._keys and self._keys[code] is None

    def add(self, code: str) -> None:
        """Makes a key for a new participant; it is on disk when this returns. An existing key stays.

        Raises:
            StudyError: The file cannot be written.
        """
        if code not in self._keys:
            key = AESGCM.generate_key(256)
            self._save(self._keys | {code: base64.b64encode(key).decode()})
            self._ciphers[code] = AESGCM(key)

    def shred(self, code: str) -> None:
        """Deletes a participant's key; nobody can read the encrypted data from now on.

        A mark stays in its place, so that a restored older backup of the database is understood.

        Raises:
            StudyError: The file cannot be written.
        """
        if not self.is_shredded(code):
            self._save(self._keys | {code: None})
            self._ciphers.pop(code, None)

    def seal(self, code: str, text: str, *, where: str) -> str:
        """The text as a JSON string of ciphertext, bound to its place in the database.

        Raises:
            StudyError: The participant has no key (any more).
        """
        nonce = secrets.token_bytes(_NONCE_BYTES)
        sealed = nonce + self._cipher(code).encrypt(nonce, text.encode(), where.encode())
        return json.dumps(base64.b64encode(sealed).decode())

    def open(self, code: str, payload: str, *, where: str) -> str:
        """The text of a payload.

        Raises:
            StudyError: The key is gone or the payload was changed.
        """
        sealed = base64.b64decode(json.loads(payload))
        try:
            text = self._cipher(code).decrypt(sealed[:_NONCE_BYTES], sealed[_NONCE_BYTES:], where.encode())
        except InvalidTag:
            raise StudyError(
                f"{self._path.parent}: {where} cannot be decrypted; expected a payload as it was written, and its own "
                "key. Restore the folder from a backup, with keys.json."
            ) from None
        return text.decode()

    def _cipher(self, code: str) -> AESGCM:
        if code not in self._ciphers:
            raise StudyError(
                f"{self._path}: has no key of participant {code}; expected one, unless the participant withdrew. "
                "Restore keys.json if it was lost."
            )
        return self._ciphers[code]

    def _save(self, keys: dict[str, str | None]) -> None:
        write_private(self._path, json.dumps(keys, indent=1, sort_keys=True) + "\n")
        self._keys = keys
