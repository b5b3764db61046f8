"""The files of docs/deploy name commands and folders that exist; a study survives a move and a restored backup."""

import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tomllib
from fnmatch import fnmatchcase
from pathlib import Path, PurePosixPath

import pytest
import yaml

from human_study.design.plan import save_plan
from human_study.design.study import save_study
from human_study.store.records import read_study
from personal_viz.bots.forms import answer_pages, open_session
from personal_viz.cli.study.serve import StudyServe
from personal_viz.cli.verbs import parse
from personal_viz.study_app.gateway.filter import CAMERA
from personal_viz.study_app.gateway.options import ServeOptions, require_may_serve
from personal_viz.study_app.operator.served import free_port
from sim.errors import StudyError
from tests.human_study.small_world import study as study_of
from tests.human_study.stores import do_next, started

from .flow_steps import acts, progress
from .flow_studies import served
from .gateways import running
from .program import personal_viz
from .wire import WireClient, line_to

ROOT = Path(__file__).parents[2]
FILES = ROOT / "docs" / "deploy"
DEPLOY = ROOT / "docs" / "deploy.md"
HOME = "/var/lib/study"
"""The studies' folder in the document."""
PROGRAM = "/opt/personal-viz/.venv/bin/personal-viz"
SECRETS = {"keys.json", "secrets.json", "sessions.json"}
HALF_WRITTEN = ("keys.json.part", "pay.db-journal", "pay.db-wal", "pay.db-shm")


def settings() -> dict[str, str]:
    """The names and values of study.env."""
    lines = (FILES / "study.env").read_text(encoding="utf-8").splitlines()
    return dict(line.split("=", 1) for line in lines if line and not line.startswith("#"))


def compose() -> dict:
    """The services of compose.yaml, with the values of study.env."""
    text = (FILES / "compose.yaml").read_text(encoding="utf-8")
    named = set(re.findall(r"\$\{(\w+)", text))
    assert named == set(settings()), "study.env has what compose.yaml names, and no more"
    return yaml.safe_load(re.sub(r"\$\{(\w+)(:\?[^}]*)?\}", lambda found: settings()[found[1]], text))


def unit(name: str) -> dict[str, list[str]]:
    """The values of a unit file by key."""
    found: dict[str, list[str]] = {}
    for line in (FILES / name).read_text(encoding="utf-8").splitlines():
        key, is_set, value = line.partition("=")
        if is_set and not line.startswith("#"):
            value = re.sub(r"\$\{(\w+)\}", lambda name: settings()[name[1]], value)
            found.setdefault(key, []).append(value)
    return found


def commands(heading: str) -> list[str]:
    """The lines of the command blocks below a heading of docs/deploy.md."""
    part = DEPLOY.read_text(encoding="utf-8").split(f"### {heading}\n", 1)[1].split("\n### ")[0].split("\n## ")[0]
    return [line for block in re.findall(r"```sh\n(.*?)```", part, re.DOTALL) for line in block.splitlines()]


def test_docker_and_systemd_serve_alike_and_as_the_gateway_allows() -> None:
    gateway, service = compose()["services"]["gateway"], unit("study.service")
    program, *words = shlex.split(service["ExecStart"][0])
    assert program == PROGRAM
    by_systemd, by_docker = parse(words), parse(gateway["command"])
    assert isinstance(by_systemd, StudyServe)
    assert isinstance(by_docker, StudyServe)
    assert by_systemd.serving == by_docker.serving
    assert by_systemd.serving.hosts == ("study.example.org",)
    require_may_serve(by_systemd.serving, study_of(ethics={"irb": "2026-17"}), ["scan"])
    assert (str(by_systemd.study), str(by_systemd.dataset)) == (settings()["STUDY"], settings()["DATASET"])
    assert settings()["STUDY"].startswith(f"/var/lib/{service['StateDirectory'][0]}/")
    mounts = [volume.split(":")[:2] for volume in gateway["volumes"]]
    assert [settings()["STUDY"], str(by_docker.study)] in mounts
    assert [settings()["DATASET"], str(by_docker.dataset)] in mounts
    for stop_s in (gateway["stop_grace_period"].removesuffix("s"), service["TimeoutStopSec"][0]):
        assert float(stop_s) > ServeOptions().drain_s


def test_every_file_that_is_named_is_there() -> None:
    services = compose()["services"]
    build = services["gateway"]["build"]
    assert (FILES / build["context"]).resolve() == ROOT
    assert (ROOT / build["dockerfile"]) == FILES / "Dockerfile"
    (caddyfile,) = (volume for volume in services["caddy"]["volumes"] if volume.startswith("./"))
    assert (FILES / caddyfile.split(":")[0]).read_text(encoding="utf-8").count("127.0.0.1:8080") == 1
    named = [volume.split(":")[0] for service in services.values() for volume in service["volumes"]]
    assert {name for name in named if name[0] not in "./"} == set(compose()["volumes"])
    script = unit("study-backup.service")["ExecStart"][0].split()[0]
    assert script == f"/opt/personal-viz/{(FILES / 'backup').relative_to(ROOT)}"
    assert f"{(FILES / 'backup').relative_to(ROOT)} /study /backup /keys" in services["backup"]["entrypoint"][-1]
    assert os.access(FILES / "backup", os.X_OK)
    assert "WORKDIR /opt/personal-viz\n" in (FILES / "Dockerfile").read_text(encoding="utf-8")
    linked = re.findall(r"\]\((deploy/[^)]+)\)", DEPLOY.read_text(encoding="utf-8"))
    assert {Path(link).name for link in linked} == {path.name for path in FILES.iterdir()} - {"Dockerfile.dockerignore"}


def is_copied(path: str) -> bool:
    """Whether Docker copies a file: the ignore file's last line that names it, or a folder of it, decides."""
    lines = (FILES / "Dockerfile.dockerignore").read_text(encoding="utf-8").splitlines()
    places = [path, *map(str, PurePosixPath(path).parents)]
    decided = [
        line.startswith("!")
        for line in lines
        if not line.startswith("#") and any(fnmatchcase(place, line.removeprefix("!")) for place in places)
    ]
    return not decided or decided[-1]


def test_the_image_holds_all_that_is_installed_and_no_study() -> None:
    recipe = re.search(r"^\$\(VENV\)/\.demo: (.*)\n((?:\t.*\n)+)", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE)
    assert recipe is not None
    program = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    packages = [name.rstrip("*") for name in program["tool"]["setuptools"]["packages"]["find"]["include"]]
    texts = [program["project"]["readme"], *program["project"]["license-files"], "requirements-torch.lock"]
    scripts = [*re.findall(r"\.ci/\w+\.py", recipe[2]), "Makefile", "docs/deploy/backup"]
    needed = [*recipe[1].split(), *texts, *scripts, *(f"{name}/__init__.py" for name in packages)]
    assert [path for path in needed if not (ROOT / path).is_file()] == []
    assert [path for path in needed if not is_copied(path)] == []
    private = ["my-study/study.db", "my-study/keys.json", "split/demo.json.gz", "runs/a/run.json", ".git/config"]
    private += [".venv/bin/python", "docs/deploy/key.pem", "sim/__pycache__/types.pyc", "study.db"]
    assert [path for path in private if is_copied(path)] == []


def test_the_health_check_asks_the_gateway(tmp_path: Path) -> None:
    kind, program, *words = compose()["services"]["gateway"]["healthcheck"]["test"]
    assert (kind, program) == ("CMD", "python")
    with running(tmp_path) as gateway:
        asked = [word.replace(":8080/", f":{gateway.port}/") for word in words]
        assert subprocess.run([sys.executable, *asked], timeout=60).returncode == 0
    done = subprocess.run([sys.executable, *asked], capture_output=True, timeout=60)
    assert done.returncode != 0


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="found no systemd; install it to check the units")
def test_systemd_takes_the_units_and_finds_the_service_shut_off(tmp_path: Path) -> None:
    names = ("study.service", "study-backup.service", "study-backup.timer")
    for name in names:
        text = (FILES / name).read_text(encoding="utf-8")
        text = re.sub(r"/opt/personal-viz/\S+", "/bin/true", text)
        (tmp_path / name).write_text(text, encoding="utf-8")
    paths = [str(tmp_path / name) for name in names]
    done = subprocess.run(["systemd-analyze", "verify", "--man=no", *paths], capture_output=True, text=True, timeout=60)
    ours = [line for line in done.stderr.splitlines() if "study" in line]
    assert ours == []
    asked = ["systemd-analyze", "security", "--offline=true", "--no-pager", "--threshold=20"]
    judged = subprocess.run([*asked, paths[0]], capture_output=True, text=True, timeout=60)
    assert judged.returncode == 0, judged.stdout[-300:]


def test_a_restored_backup_has_everything_but_what_came_after_it(tmp_path: Path) -> None:
    folder, copies, keys = (tmp_path / name for name in ("served", "copies", "keys"))
    (copies / "my-study").mkdir(parents=True)
    (keys / "my-study").mkdir(parents=True)
    asked = [str(FILES / "backup"), str(folder), str(copies / "my-study"), str(keys / "my-study")]

    def back_up() -> None:
        done = subprocess.run(asked, capture_output=True, text=True, timeout=60)
        assert (done.returncode, done.stderr) == (0, "")

    with started(folder) as store:
        save_study(folder, store.config)
        save_plan(folder, store.plan)
        done = [do_next(store, code) for code in ("p01", "p02")]
        store.back_up()
        back_up()
        store.withdraw("p02")
        (folder / "pay.db").write_bytes(b"ids")
        back_up()
        assert (keys / "my-study" / "pay.db").exists()
        (folder / "pay.db").unlink()
        for name in HALF_WRITTEN:
            (folder / name).write_text("key")
            (copies / "my-study" / name).write_text("left by an earlier run")
        migrated = folder / "backups" / "study-v2-1.db"
        migrated.write_bytes(b"from before an upgrade")
        for number in range(105):
            (copies / "my-study" / "backups" / f"study-{number:03}.db").touch()
        back_up()
        for name in HALF_WRITTEN:
            (folder / name).unlink()
        do_next(store, "p01")
    kept = sorted(path.name for path in (copies / "my-study" / "backups").iterdir())
    assert (len(kept), kept[0], kept[-1]) == (101, "study-006.db", migrated.name)
    assert [path.name for path in (keys / "my-study").iterdir()] == ["keys.json"]
    unwanted = {*SECRETS, *HALF_WRITTEN}
    assert not any(
        path.name in unwanted or path.name.startswith("study.db") for path in (copies / "my-study").iterdir()
    )
    (folder / "study.db").write_bytes(b"damaged")

    stops, *lines, starts = commands("Backups")
    assert stops == "systemctl stop study study-backup.timer study-backup.service"
    assert starts == "systemctl start study study-backup.timer"
    for line in lines:
        line = line.replace("/mnt/backup", str(copies)).replace("/mnt/keys", str(keys))
        run(line.replace(f"{HOME}/my-study", str(folder)))
    with read_study(folder) as reader:
        reader.check()
        ended = [trial for trial in reader.trials("p01") if trial.outcome is not None]
        assert len(ended) == 1
        assert done[0] is not None
    with started(folder) as store:
        assert do_next(store, "p01") not in (None, done[0])
        with pytest.raises(StudyError, match=r"p02"):
            do_next(store, "p02")


@pytest.mark.parametrize(
    ("missing", "said"),
    [(0, "found no study.yaml; expected a study's folder"), (1, "found no folder"), (2, "found no folder")],
)
def test_a_backup_without_its_disk_fails_and_writes_nothing(tmp_path: Path, missing: int, said: str) -> None:
    places = [tmp_path / name for name in ("study", "copies", "keys")]
    save_study(places[0], study_of())
    places[1].mkdir()
    places[2].mkdir()
    places[missing].rename(tmp_path / "away")
    done = subprocess.run([str(FILES / "backup"), *map(str, places)], capture_output=True, text=True, timeout=60)
    assert done.returncode == 1
    assert f"backup: {places[missing]}: {said}" in done.stderr
    assert not any(path.is_file() for place in places[1:] for path in place.rglob("*"))


def run(line: str) -> None:
    """A command of the document, our own program in this process."""
    as_study, is_ours, words = line.partition(f"{PROGRAM} ")
    if is_ours:
        assert as_study == "runuser -u study -- "
        done = personal_viz(*shlex.split(words))
        assert (done.returncode, done.stderr) == (0, ""), line
    else:
        subprocess.run(["/bin/sh", "-ec", line], check=True, timeout=60)


def press(walker: WireClient, step: int, key: str) -> None:
    """Presses a key once the picture of a step is there."""
    walker.see_step(step)
    command = walker.receive_until(
        lambda message: message.get("type") == "RegisterCommandMessage" and message["props"].get("hotkey") == key
    )
    walker.send({"type": "CommandTriggerMessage", "uuid": command["uuid"]})


@pytest.mark.slow
def test_a_study_moves_to_another_machine_and_an_open_page_goes_on_at_the_same_step(
    quick_folder: Path, tmp_path: Path
) -> None:
    dataset, port = quick_folder.parent / "dataset", free_port()
    old, new = tmp_path / "old", tmp_path / "new"
    old.mkdir()
    new.mkdir()
    quick_folder.rename(old / "my-study")
    lines = iter(commands("Moving a running study"))
    with served(old / "my-study", dataset, port=port) as first:
        session = open_session(first.links["p01"])
        assert answer_pages(session) is None
        page = session.view.split("websocket=")[1]
        headers = {"Cookie": session.cookie, "Origin": session.origin}
        line = line_to(page, additional_headers=headers)
        with line:
            walker = WireClient(line)
            walker.send(CAMERA)
            for step, key in enumerate("AW"):
                press(walker, step, key)
            walker.see_step(2)
            assert next(lines) == "systemctl disable --now study study-backup.timer"
            first.process.send_signal(signal.SIGTERM)
            assert first.process.wait(timeout=60) == 0
    before = acts(old / "my-study", "p01")
    assert [act.action.value for act in before] == ["left", "forward"]
    run(next(lines).replace(f"| ssh NEW tar -C {HOME}", f"| tar -C {new}").replace(HOME, str(old)))
    run(next(lines).replace(HOME, str(old)))
    assert not (old / "my-study").exists()

    run(next(lines).replace(HOME, str(new)))
    assert next(lines) == "systemctl enable --now study study-backup.timer"
    assert list(lines) == []
    with served(new / "my-study", dataset, port=port, ended_by=signal.SIGTERM) as second:
        assert second.links == first.links
        line = line_to(page, additional_headers=headers)
        with line:
            walker = WireClient(line)
            walker.send(CAMERA)
            walker.see_step(2)
            found = progress(new / "my-study", "p01")
            assert (found.place, found.num_abandoned, found.num_technical) == ("trial", 0, 0)
            press(walker, 2, "D")
            walker.see_step(3)
    after = acts(new / "my-study", "p01")
    assert after[:2] == before
    assert [act.action.value for act in after] == ["left", "forward", "right"]
    assert after[2].position == before[1].position
