"""What a study stores about people: where, why, for how long, and who sees it. One list for all documents."""

from collections.abc import Sequence
from dataclasses import dataclass

from ..design.study import StudyConfig
from .words import hashes_platform_ids

_TEAM = "the people with an account on the computer that runs the study"


@dataclass(frozen=True, slots=True)
class DataItem:
    """One kind of data."""

    name: str
    purpose: str
    place: str
    """File and form in which it is kept."""
    readers: str
    """Who can see it."""
    until: str
    """When it is deleted, and how."""


def data_items(config: StudyConfig, *, retention: str) -> tuple[DataItem, ...]:
    """Everything that is stored about participants.

    Args:
        config: The study.
        retention: Date on which the records are deleted, or the mark that it is still to be filled in.
    """
    end = f"{retention}, with the study's folder"
    is_shredded = config.privacy.on_withdraw == "delete"
    gone = f"withdrawal, by deleting the person's key; else {end}" if is_shredded else end
    return (
        *_person_items(end),
        *_trial_items(config, end=end, gone=gone),
        *_copies(end),
        *_platform_items(config, end=end),
    )


def _person_items(end: str) -> tuple[DataItem, ...]:
    """About a person, in clear."""
    stays = f"{end}; stays after a withdrawal"
    return (
        DataItem(
            "personal link",
            "lets a person come back to the same place in the study",
            "secrets.json, readable by its owner only; in the database only a hash of it",
            _TEAM,
            end,
        ),
        DataItem(
            "code (p01, p02, ...), task, order of trials",
            "says who does which trial",
            "plan.json and study.db, in clear",
            _TEAM,
            stays,
        ),
        DataItem(
            "answer about consent, hash of the text, time",
            "proves consent",
            "study.db, in clear, append-only",
            _TEAM,
            stays,
        ),
        DataItem(
            "open sessions: hash of a cookie, code, coarse kind of browser window",
            "lets a page go on after a reload or a restart of the server",
            "sessions.json, readable by its owner only",
            _TEAM,
            end,
        ),
        DataItem(
            "parts of the study that were reached, with times; result of the browser check (rounded size of the "
            "window, density of its pixels, 3-D pictures, keyboard and touch screen yes or no); chosen keys; "
            "mistakes in the quiz",
            "brings a person back to the same place; shows where people drop out",
            "study.db, in clear, append-only",
            _TEAM,
            stays,
        ),
    )


def _trial_items(config: StudyConfig, *, end: str, gone: str) -> tuple[DataItem, ...]:
    """About what a person did."""
    confidence = ", stated confidence" if config.confidence else ""
    return (
        DataItem(
            "what a person does in each trial: keys, buttons, clicks, the robot's way, camera of the 3-D view, "
            f"times, page in the background{confidence}",
            "is what the study measures",
            "study.db, encrypted with a key of the person's own (AES-256-GCM)",
            _TEAM,
            gone,
        ),
        DataItem(
            "result of each trial: found or not, distances, length of the way",
            "is what the study measures",
            "study.db, encrypted with the person's key",
            f"{_TEAM}, after the study; progress displays show no results",
            gone,
        ),
        DataItem(
            "that a trial took place, how it ended, number, kind and server time of its events, hashes that chain them",
            "shows that no record was added, changed or lost",
            "study.db, in clear, append-only",
            _TEAM,
            f"{end}; stays after a withdrawal",
        ),
        DataItem(
            "key of each person", "decrypts the person's records", "keys.json, readable by its owner only", _TEAM, gone
        ),
    )


def _copies(end: str) -> tuple[DataItem, ...]:
    """Backups and exports."""
    return (
        DataItem(
            "backups of the database",
            "protect against loss",
            "folder backups, with the same encryption and never with a key",
            _TEAM,
            end,
        ),
        DataItem(
            "export: tables and run files under new codes, times from the start of each trial, sizes of windows "
            "rounded, no ids",
            "analysis, and publication of the data",
            "folder exports, and wherever it is published",
            "anybody, once it is published",
            "not at all, once it is published; made again without people who withdraw before that",
        ),
    )


def _platform_items(config: StudyConfig, *, end: str) -> Sequence[DataItem]:
    """What a recruiting platform brings."""
    items = []
    if hashes_platform_ids(config):
        items.append(
            DataItem(
                "code made of the id on the recruiting platform with a key of the study (HMAC-SHA256)",
                "keeps people from taking part twice",
                "study.db; the key is in secrets.json",
                _TEAM,
                f"{end}; stays after a withdrawal",
            )
        )
    if hashes_platform_ids(config) and config.privacy.platform_id == "hmac":
        items.append(
            DataItem(
                "id on the recruiting platform",
                "payment",
                "pay.db, apart from the records, readable by its owner only; no export reads it",
                _TEAM,
                f"payment, by `study purge-ids`; at the latest {end}",
            )
        )
    if config.recruit.kind == "prolific":
        items.append(
            DataItem(
                "completion, screen-out or no-consent code",
                "tells the platform that a person is to be paid",
                "secrets.toml, readable by its owner only; shown to the person at the end",
                "the person, and through the person the platform",
                end,
            )
        )
    return items
