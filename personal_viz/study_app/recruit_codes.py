"""`secrets.toml` of a study: codes for the recruiting platform, written by the researcher and never exported."""

import hashlib
import hmac
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from human_study.journey import Stage
from sim.errors import StudyError, line_from_validation_error

CODES_FILE = "secrets.toml"
_ADVICE = 'Correct it: [prolific] with completion = "...", screen_out = "..." and no_consent = "...".'
_PROLIFIC_PAGE = "https://app.prolific.com/submissions/complete?cc="
_Code = Annotated[str, Field(pattern=r"^[A-Za-z0-9-]{4,32}$")]


class ProlificCodes(BaseModel):
    """Codes made on Prolific's page of the study."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    completion: _Code
    """Code for people who finished."""
    screen_out: _Code | None = None
    """Code for people who cannot take part, or find the study full."""
    no_consent: _Code | None = None
    """Code for people who declined."""


class RecruitCodes(BaseModel):
    """The whole file."""

    model_config = ConfigDict(frozen=True, extra="forbid")
    prolific: ProlificCodes | None = None


def load_recruit_codes(folder: Path) -> RecruitCodes:
    """The codes of a study folder; empty when there is no file.

    Raises:
        StudyError: The file is not TOML or holds something else.
    """
    path = folder / CODES_FILE
    try:
        return RecruitCodes.model_validate(tomllib.loads(path.read_text("utf-8")))
    except FileNotFoundError:
        return RecruitCodes()
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise StudyError(f"{path}: cannot be read ({error}); expected TOML. {_ADVICE}") from None
    except ValidationError as error:
        raise StudyError(line_from_validation_error(path, error, advice=_ADVICE)) from None


@dataclass(frozen=True, slots=True)
class EndCode:
    """The code that a participant gets at the end."""

    code: str | None = None
    url: str | None = None
    """The platform's page that takes the code."""


def end_code(codes: RecruitCodes, key: bytes, code: str, ending: Stage) -> EndCode:
    """The code for a participant who ended by this stage.

    Args:
        codes: Codes of the platform that people come from, if any.
        key: The study's own key.
        code: The participant.
        ending: `finished`, or the stage by which the participant left.

    Returns:
        The platform's code and page; without a platform, a code of our own for people who finished. People who withdrew
        get nothing: platforms ask them to give their place back.
    """
    if codes.prolific is None:
        return EndCode(_own_code(key, code)) if ending == "finished" else EndCode()
    of_platform = {
        "finished": codes.prolific.completion,
        "declined": codes.prolific.no_consent,
        "screened_out": codes.prolific.screen_out,
        "full": codes.prolific.screen_out,
    }.get(ending)
    return EndCode(of_platform, f"{_PROLIFIC_PAGE}{of_platform}") if of_platform is not None else EndCode()


def _own_code(key: bytes, code: str) -> str:
    """Eight digits that only the study's key can make."""
    return hmac.new(key, f"completion {code}".encode(), hashlib.sha256).hexdigest()[:8].upper()
