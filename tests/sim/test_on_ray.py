"""Ray as workers: the results of one process, also when a machine of the cluster is lost in the middle of the work."""

import os
import select
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from grounding.evaluation.evaluate import Answered, GroundJob, open_job, select_jobs
from grounding.evaluation.home_maps import MapFolders
from grounding.evaluation.settings import GroundSettings
from personal_viz.cli.runs.run import Run
from sim.episodes.dataset import PersonalDataset
from sim.errors import AgentError, PersonalVizError
from sim.tasks.on_ray import ENVIRONMENT, RayCluster
from sim.tasks.provenance import make_run_info
from sim.tasks.run_writer import RunWriter
from sim.tasks.workers import SceneJob, Workers, results, run_jobs
from sim.types import EpisodeKey

HELD = ("easy", "2")
"""Split and id of the episode in the middle of which the work of a home is held until a machine is lost."""
HOMES = ("HomeOne", "HomeTwo")
LOOPBACK = "127.0.0.2"
"""Ray replaces 127.0.0.1 by this machine's address in its network."""
STORE_BYTES = 80 << 20
"""The smallest store of objects that Ray accepts is 75 MB."""

pytestmark = [pytest.mark.release, pytest.mark.timeout(900)]  # a cluster and its workers take a minute or more


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """A cluster of two machines of one core each, on loopback; it ends with the tests of this module."""
    pytest.importorskip("ray", reason="the extra ray is not installed: pip install 'personal-viz[ray]'")
    from ray.cluster_utils import Cluster

    with pytest.MonkeyPatch.context() as patch:
        for name, value in ENVIRONMENT.items():  # the cluster's machines read it, not only the driver
            patch.setenv(name, value)
        machine = {"num_cpus": 1, "object_store_memory": STORE_BYTES, "node_ip_address": LOOPBACK}
        made = Cluster(initialize_head=True, head_node_args={**machine, "include_dashboard": False})
        yield made
        made.shutdown()


def open_held(job: GroundJob) -> Callable[[EpisodeKey], Answered]:
    """Answers episodes, and notes each that it begins; in `HELD`, the first time, it waits for the test.

    The job's folder of maps, which oracle maps do not need, holds the notes.
    """
    answer = open_job(job)
    assert job.folders is not None
    notes = job.folders.maps / "begun"

    def held(key: EpisodeKey) -> Answered:
        is_first = str(key) not in notes.read_text().split()
        with notes.open("a") as file:
            file.write(f"{key} {os.getpid()}\n")
        if (key.split, key.episode_id) == HELD and is_first:
            notes.with_name(f"hold-{key.scene}").read_bytes()  # until the test has opened and closed it
        return answer(key)

    return held


def answers(jobs: list[GroundJob], out: Path, workers: Workers) -> bytes:
    """The bytes of the answers that `workers` give."""
    info = make_run_info("a", who="a", who_kind="agent", scene_kind="oracle-map", dataset_digest="d", seed=0)
    writer = RunWriter(out, info)
    for answered in results(open_held if workers != 1 else open_job, jobs, processes=workers, batch=8):
        writer.add_answers([answered.answer])
    return (out / "answers.jsonl").read_bytes()


def test_a_machine_lost_in_the_middle_costs_no_finished_episode_and_changes_no_byte(
    cluster: Any, small_root: Path, tmp_path: Path
) -> None:
    folders = MapFolders(tmp_path, tmp_path)
    jobs = select_jobs(PersonalDataset(small_root), GroundSettings("random"), folders=folders)
    holds = [tmp_path / f"hold-{home}" for home in HOMES]
    for hold in holds:
        os.mkfifo(hold)
    (tmp_path / "begun").touch()
    assert [job.scene for job in jobs] == list(HOMES)
    second = cluster.add_node(num_cpus=1, object_store_memory=STORE_BYTES, node_ip_address=LOOPBACK)
    cluster.wait_for_nodes()
    ended: list[tuple[int, int]] = []

    def lose_the_second() -> None:
        """Notes of how many processes, which held their episodes, how many ended with the second machine."""
        with holds[0].open("wb"), holds[1].open("wb"):  # each opens when that home's worker waits
            pids = {int(line.split()[1]) for line in (tmp_path / "begun").read_text().splitlines()}
            handles = [os.pidfd_open(pid) for pid in pids]
            cluster.remove_node(second, allow_graceful=False)
            lost, _, _ = select.select(handles, [], [], 60.0)  # its worker ends soon after the machine's own process
            for handle in handles:
                os.close(handle)
        ended.append((len(handles), len(lost)))

    losing = threading.Thread(target=lose_the_second, daemon=True)
    losing.start()
    found = answers(jobs, tmp_path / "ray", RayCluster(cluster.address))
    losing.join()
    assert ended == [(2, 1)]
    assert found == answers(jobs, tmp_path / "one", 1)
    assert found.count(b"\n") == sum(len(job.keys) for job in jobs) == 11
    begun = (tmp_path / "begun").read_text().split()[::2]
    (again,) = {key for key in begun if begun.count(key) > 1}  # no other episode was begun twice
    assert again in ("easy/HomeOne/2", "easy/HomeTwo/2")
    assert len(begun) == 12


def test_a_run_on_ray_is_the_run_of_one_process(cluster: Any, invented_root: Path, tmp_path: Path) -> None:
    options = {"limit": 1, "split": ("easy", "hard"), "out": tmp_path}
    Run(invented_root, "random", **options, run_id="ray", on="ray", address=cluster.address).run()
    Run(invented_root, "random", **options, run_id="one").run()
    found = (tmp_path / "ray" / "steps.jsonl").read_bytes()
    assert found.count(b'"kind":"end"') == 2
    assert found == (tmp_path / "one" / "steps.jsonl").read_bytes()


def refuse(name: str) -> tuple[str, int]:
    """The name and its process's niceness; raises for one name."""
    if name == "B":
        raise AgentError("B: no.")
    return name, os.nice(0)


def open_ended(job: SceneJob) -> Callable[[EpisodeKey], str]:
    """Ends its process in every episode of home C."""

    def name(key: EpisodeKey) -> str:
        if key.scene == "C":
            os._exit(9)
        return key.scene

    return name


def test_errors_of_the_work_and_of_the_cluster_are_one_line(cluster: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sim.tasks.on_ray.MOST_LOSSES", 1)
    workers = RayCluster(cluster.address)
    assert sorted(run_jobs(refuse, ["A", "C"], processes=workers)) == [("A", os.nice(0)), ("C", os.nice(0))]
    with pytest.raises(AgentError, match=r"^B: no\.$"):
        list(run_jobs(refuse, ["B"], processes=workers))
    jobs = [SceneJob(Path("nowhere"), home, (EpisodeKey("easy", home, "1"),)) for home in ("A", "C")]
    with pytest.raises(
        PersonalVizError, match=r"--on ray: the worker of C was lost 2 times \(.*; expected it to finish"
    ):
        list(results(open_ended, jobs, processes=workers, batch=1))
    with pytest.raises(PersonalVizError, match=r"no machine of the cluster has a graphics card; .* give --device cpu"):
        list(run_jobs(refuse, ["A"], processes=RayCluster(cluster.address, num_gpus=1.0)))
    with pytest.raises(PersonalVizError, match=r"--address is '127.0.0.1:1' .*expected HOST:PORT of a running cluster"):
        list(run_jobs(refuse, ["A"], processes=RayCluster("127.0.0.1:1")))
