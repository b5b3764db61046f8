"""HUMAN_STUDY.md, section 10, test 22: planted ids, addresses and user agents are in no file of the study except the
file for paying people, and there only when the study file asks for them."""

import json
from pathlib import Path

import pytest
from starlette.testclient import TestClient

from human_study.design.secrets import new_token, token_hash
from human_study.store.store import open_store
from personal_viz.study_app.gateway.admission import PAY_FILE, Admission, PayFile, Tickets
from personal_viz.study_app.gateway.app import Gateway
from personal_viz.study_app.gateway.options import ServeOptions
from tests.human_study.small_world import plan, study

from .gateways import KEY, NO_PAGES, OnePort

PERSON = "CANARY5f1e0c9a7b3d"
PUBLIC = ServeOptions(public=True, hosts=("study.example.org",), proxy="10.0.0.9", pilot=True)
HEADERS = {
    "host": "study.example.org",
    "origin": "https://study.example.org",
    "x-forwarded-for": "198.51.100.77",
    "user-agent": "CanaryBrowser/1.0",
    "referer": "https://canary.example/",
    "cookie": "tracking=canary-cookie",
}
DEVICE = {"webgl2": True, "width": 1311, "height": 777, "dpr": 1.13, "touch": False}


def visited(folder: Path, *, platform_id: str) -> dict[str, bytes]:
    """The files of a study after somebody came from Prolific, entered, and entered again; by name."""
    config = study(recruit={"kind": "prolific"}, privacy={"platform_id": platform_id})
    planned = plan(config)
    with open_store(folder, config, planned) as store:
        tokens = {person.code: new_token() for person in planned.participants}
        for person in planned.participants:
            store.add_participant(person, token_hash(tokens[person.code]))
        admission = Admission(store, config, token_of_code=tokens, platform_key=KEY, pay_file=PayFile(folder))
        gateway = Gateway(admission, OnePort(9), tickets=Tickets(folder), options=PUBLIC, pages=NO_PAGES)
        client = TestClient(gateway.app(), base_url="https://study.example.org", client=("10.0.0.9", 5000))
        arrival = {"PROLIFIC_PID": PERSON, "STUDY_ID": "CANARYstudy", "SESSION_ID": "CANARYsession"}
        client.get("/join", params=arrival, headers=HEADERS)
        found = [client.post("/join", json=arrival, headers=HEADERS).json()["token"] for _ in range(2)]
        assert found[0] == found[1] == tokens["p01"]
        for _ in range(2):
            entered = client.post("/enter", json={"token": found[0], "device": DEVICE}, headers=HEADERS)
            assert entered.status_code == 200
        return {path.name: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("platform_id", ["none", "hmac"])
def test_nothing_that_names_a_person_is_in_the_files_of_the_study(
    tmp_path: Path, platform_id: str, capfd: pytest.CaptureFixture[str]
) -> None:
    files = visited(tmp_path, platform_id=platform_id)
    assert {"study.db", "sessions.json"} <= set(files)
    (ticket,) = json.loads(files["sessions.json"]).values()
    assert ticket["profile"] == {"webgl2": True, "width": 1300, "height": 800, "dpr": 1.25, "touch": False}
    paid = files.pop(PAY_FILE, b"")
    assert (PERSON.encode() in paid) == (platform_id == "hmac")
    out, error = capfd.readouterr()
    for name, data in {**files, "out": out.encode(), "error": error.encode()}.items():
        for canary in (b"canary", b"198.51.100", b"10.0.0.9"):
            assert canary not in data.lower(), (name, canary)
