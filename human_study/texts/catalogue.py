"""The language of a study: every text that participants read, in one folder per language (`languages/en`, ...).

`words.toml` holds the short texts by key, with places in braces; the Markdown beside it holds the long ones (`words.py`
fills them in). English is complete; every other language has the same keys and places, or it is refused.
"""

import datetime
import functools
import hashlib
import math
import re
import string
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sim.errors import StudyError

LANGUAGES = Path(__file__).parent / "languages"
WORDS_FILE = "words.toml"
ENGLISH = "en"


@dataclass(frozen=True, slots=True, eq=False)
class Catalogue:
    """The texts of one language; called with a key it gives a short text."""

    language: str
    """The language's tag (BCP 47), such as `de`."""
    folder: Path
    """Folder of `words.toml` and the Markdown."""
    texts: Mapping[str, str]
    """Short texts by key, such as `rest.title`, with unfilled places."""

    @property
    def name(self) -> str:
        """Name of the language among the texts that a plan freezes."""
        return f"{LANGUAGES.name}/{self.language}"

    def digest(self) -> str:
        """sha256 of all texts of the language, 64 hex digits."""
        hashed = hashlib.sha256()
        for path in sorted(self.folder.iterdir()):
            hashed.update(f"{path.name} {hashlib.sha256(path.read_bytes()).hexdigest()}\n".encode())
        return hashed.hexdigest()

    def __call__(self, key: str, **places: object) -> str:
        """The short text with this key, with its places filled in; plain text, not HTML."""
        return self.texts[key].format(**places)

    def pattern(self, key: str, **places: object) -> str:
        """A regular expression for a shown text, in which each place that is not given is a group."""
        parts = string.Formatter().parse(self.texts[key])
        return "".join(
            re.escape(before) + ("" if name is None else re.escape(str(places[name])) if name in places else "(.+?)")
            for before, name, _, _ in parts
        )

    def under(self, *tables: str) -> dict[str, str]:
        """The unfilled texts of some tables by key, for scripts in the browser; and `language`."""
        found = {key: text for key, text in self.texts.items() if key.partition(".")[0] in tables}
        return {"language": self.language, **found}

    def how_many(self, count: float, one: str, many: str) -> str:
        """ "1 minute", "2.5 metres": a number with its unit.

        Args:
            count: How many there are.
            one: Key, in the table `number`, of the unit for one.
            many: Key of the unit for any other number.
        """
        number = f"{count:g}".replace(".", self.texts["number.decimal"])
        return self(f"number.{one if count == 1 else many}", count=number)

    def length(self, metres: float) -> str:
        """ "10 centimetres", "1.5 metres"."""
        if metres >= 1:
            return self.how_many(metres, "metre", "metres")
        return self.how_many(round(100 * metres, 6), "centimetre", "centimetres")

    def duration(self, seconds: float) -> str:
        """ "45 seconds", "2 minutes": in minutes where these are whole."""
        if seconds >= 60 and seconds % 60 == 0:
            return self.how_many(seconds // 60, "minute", "minutes")
        return self.how_many(seconds, "second", "seconds")

    def countdown(self, seconds: int) -> str:
        """ "45 seconds", "2:05 minutes": for a clock that changes every second."""
        if seconds < 60:
            return self.how_many(seconds, "second", "seconds")
        return self("number.clock", minutes=seconds // 60, seconds=f"{seconds % 60:02d}")

    def waiting_time(self, seconds: float) -> str:
        """ "1 minute", "20 minutes", "2 hours": rounded up."""
        minutes = max(1, math.ceil(seconds / 60))
        if minutes >= 90:
            return self.how_many(math.ceil(minutes / 60), "hour", "hours")
        return self.how_many(minutes, "minute", "minutes")

    def date(self, day: datetime.date) -> str:
        """The day as people write it."""
        return self("number.date", year=day.year, month=f"{day.month:02d}", day=f"{day.day:02d}")


@functools.cache
def catalogue_of(language: str) -> Catalogue:
    """The texts of one of our languages.

    Raises:
        StudyError: A text or one of its places is missing, or there is one that English does not have.
    """
    return load_catalogue(LANGUAGES / language)


def load_catalogue(folder: Path) -> Catalogue:
    """The texts in a folder with `words.toml`.

    Raises:
        StudyError: As `catalogue_of`; or the file cannot be read.
    """
    path = folder / WORDS_FILE
    try:
        texts = dict(_flat(tomllib.loads(path.read_text(encoding="utf-8"))))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise StudyError(
            f"{path}: cannot be read ({error}); expected the words of a language in TOML. Restore the file."
        ) from None
    language = texts.pop("language", "")
    if folder != LANGUAGES / ENGLISH:
        _require_same(path, language, texts)
    return Catalogue(language, folder, texts)


def places_in(text: str) -> frozenset[str]:
    """Names of the places in braces.

    Raises:
        ValueError: A brace has no partner.
    """
    return frozenset(name for _, name, _, _ in string.Formatter().parse(text) if name is not None)


def _require_same(path: Path, language: str, texts: Mapping[str, str]) -> None:
    """Refuses a language that has not the keys and places of English."""
    english = catalogue_of(ENGLISH).texts
    problems = ["language is missing or empty"] if not language else []
    problems += [f"{key} is missing" for key in english if key not in texts]
    problems += [f"{key} is unknown" for key in texts if key not in english]
    for key in english:
        if key in texts:
            try:
                found, expected = places_in(texts[key]), places_in(english[key])
            except ValueError as error:
                problems.append(f"{key} cannot be filled in ({error})")
                continue
            if found != expected:
                problems.append(f"{key} has the places {sorted(found)} instead of {sorted(expected)}")
    if problems:
        raise StudyError(
            f"{path}: language {language!r}: {'; '.join(problems)}; expected the keys and places of "
            f"{LANGUAGES / ENGLISH / WORDS_FILE}. Correct the file."
        )


def _flat(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    """Every text of a table of TOML, with its keys joined by dots."""
    for key, value in table.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{key}.")
        else:
            yield f"{prefix}{key}", str(value)
