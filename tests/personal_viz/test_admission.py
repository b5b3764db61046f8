"""Tickets that outlive a restart, and platform ids that are kept only where the study file asks for them."""

import json
import sqlite3
from pathlib import Path

import pytest

from human_study.design.study import StudyPrivacy, StudyRecruit, save_study
from human_study.journey import Stage
from personal_viz.cli.study.purge_ids import StudyPurgeIds
from personal_viz.study_app.gateway.admission import (
    PAY_FILE,
    SESSIONS_FILE,
    Admission,
    Arrival,
    DeviceProfile,
    PayFile,
    Tickets,
)
from personal_viz.study_app.recruit_codes import EndCode, ProlificCodes, RecruitCodes, end_code, load_recruit_codes
from sim.errors import StudyError

from .gateways import KEY, admission_for, few_people, small_config

PERSON = Arrival("5f1e0c9a7b3d", "64aa", "77bb")


def test_tickets_go_on_after_a_restart_and_no_secret_is_on_disk(tmp_path: Path) -> None:
    profile = DeviceProfile(webgl2=True, width=1300, height=800, dpr=1.0, touch=False)
    session_id, ticket_id = Tickets(tmp_path).issue("p01", profile)
    text = (tmp_path / SESSIONS_FILE).read_text()
    assert session_id not in text
    assert ticket_id not in text
    assert (tmp_path / SESSIONS_FILE).stat().st_mode & 0o777 == 0o600
    again = Tickets(tmp_path)
    found = again.find(ticket_id)
    assert found.admits(session_id)
    assert again.code_of(ticket_id) == "p01"
    assert again.client_profile("p01") == {"webgl2": True, "width": 1300, "height": 800, "dpr": 1.0, "touch": False}
    assert again.client_profile("p02") is None
    again.issue("p01")
    assert Tickets(tmp_path).find(ticket_id) is None


def test_a_damaged_file_of_tickets_says_what_to_do(tmp_path: Path) -> None:
    (tmp_path / SESSIONS_FILE).write_text('{"a": 1}')
    with pytest.raises(StudyError, match=r"sessions\.json: cannot be read .*Delete the file"):
        Tickets(tmp_path)


def test_by_default_nothing_is_kept_of_a_platform_id_and_with_prolific_a_hash_only(tmp_path: Path) -> None:
    people = few_people()
    assert admission_for(people, tmp_path, recruit="link").join(PERSON) == "good"
    assert people.claimed == {"p01": None}
    assert list(tmp_path.iterdir()) == []
    people = few_people()
    admission = admission_for(people, tmp_path, recruit="prolific")
    assert [admission.join(PERSON), admission.join(Arrival("someoneelse")), admission.join(PERSON)] == [
        "good",
        "fine",
        "good",
    ]
    kept = people.claimed["p01"]
    assert kept is not None
    assert len(kept) == 64
    assert "5f1e0c9a7b3d" not in kept
    assert list(tmp_path.iterdir()) == []


def test_the_hash_needs_the_key_of_the_study(tmp_path: Path) -> None:
    hashes = []
    for key in (KEY, b"another key"):
        people = few_people()
        config = small_config(recruit=StudyRecruit(kind="prolific"), privacy=StudyPrivacy(platform_id="hmac"))
        tokens = {code: token for token, code in people.tokens.items()}
        Admission(people, config, token_of_code=tokens, platform_key=key, pay_file=PayFile(tmp_path)).join(PERSON)
        hashes.append(people.claimed["p01"])
    assert len(set(hashes)) == 2


def test_the_id_itself_is_in_the_file_for_paying_only(tmp_path: Path) -> None:
    people = few_people()
    admission = admission_for(people, tmp_path, recruit="prolific", platform_id="hmac")
    admission.join(PERSON)
    admission.join(PERSON)
    assert (tmp_path / PAY_FILE).stat().st_mode & 0o777 == 0o600
    with sqlite3.connect(tmp_path / PAY_FILE) as database:
        assert database.execute("SELECT * FROM payee").fetchall() == [("p01", "5f1e0c9a7b3d", "64aa", "77bb")]
    assert "5f1e" not in json.dumps(people.claimed)


def test_a_full_study_has_no_place_and_keeps_nothing(tmp_path: Path) -> None:
    people = few_people()
    admission = admission_for(people, tmp_path, recruit="prolific", platform_id="hmac")
    for number in range(3):
        assert admission.join(Arrival(f"person{number}")) is not None
    assert admission.join(PERSON) is None
    with sqlite3.connect(tmp_path / PAY_FILE) as database:
        assert database.execute("SELECT count(*) FROM payee").fetchone() == (3,)


def test_purged_ids_are_gone_and_the_place_stays(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    save_study(tmp_path, small_config())
    admission = admission_for(few_people(), tmp_path, recruit="prolific", platform_id="hmac")
    assert admission.join(PERSON) == "good"
    assert [StudyPurgeIds(study=tmp_path).run() for _ in range(2)] == [0, 0]
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(" deleted")[0] for line in lines] == ["small: 1 platform ids", "small: 0 platform ids"]
    assert not (tmp_path / PAY_FILE).exists()
    assert admission.join(PERSON) == "good"
    (tmp_path / PAY_FILE).write_bytes(b"not a database, but long enough to be taken for one" * 100)
    with pytest.raises(StudyError, match=r"pay\.db: cannot be purged"):
        PayFile(tmp_path).purge()


def test_codes_of_the_platform_are_read_and_checked(tmp_path: Path) -> None:
    assert load_recruit_codes(tmp_path).prolific is None
    path = tmp_path / "secrets.toml"
    path.write_text('[prolific]\ncompletion = "C1ABCD"\nscreen_out = "FULL-1"\n')
    codes = load_recruit_codes(tmp_path).prolific
    assert (codes.completion, codes.screen_out, codes.no_consent) == ("C1ABCD", "FULL-1", None)
    path.write_text('[prolific]\ncompletion = "<script>"\n')
    with pytest.raises(StudyError, match=r"secrets\.toml: prolific\.completion"):
        load_recruit_codes(tmp_path)
    path.write_text("[prolific\n")
    with pytest.raises(StudyError, match=r"secrets\.toml: cannot be read .*expected TOML"):
        load_recruit_codes(tmp_path)


def test_without_a_platform_a_person_who_finished_gets_a_code_that_only_the_study_can_make() -> None:
    codes = [end_code(RecruitCodes(), key, code, "finished") for key in (KEY, b"other") for code in ("p01", "p02")]
    assert len({found.code for found in codes}) == 4
    assert all(found.code is not None and len(found.code) == 8 and found.url is None for found in codes)
    assert end_code(RecruitCodes(), KEY, "p01", "finished") == codes[0]
    assert end_code(RecruitCodes(), KEY, "p01", "declined") == EndCode()


@pytest.mark.parametrize(
    ("ending", "code"),
    [("finished", "DONE1"), ("declined", "NOPE1"), ("screened_out", "OUT11"), ("full", "OUT11"), ("withdrawn", None)],
)
def test_each_ending_has_its_own_code_of_the_platform(ending: Stage, code: str | None) -> None:
    codes = RecruitCodes(prolific=ProlificCodes(completion="DONE1", no_consent="NOPE1", screen_out="OUT11"))
    found = end_code(codes, KEY, "p01", ending)
    assert found.code == code
    assert found.url == (f"https://app.prolific.com/submissions/complete?cc={code}" if code else None)
    bare = RecruitCodes(prolific=ProlificCodes(completion="DONE1"))
    assert end_code(bare, KEY, "p01", ending).code == ("DONE1" if ending == "finished" else None)
