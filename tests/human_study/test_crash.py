"""kill -9 in the middle of a trial: acknowledged events are there, and the trial goes on at the same step and pose."""

import multiprocessing
import os
import signal
import time
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
import pytest

from human_study.store.records import read_study
from human_study.trial.events import Act
from human_study.trial.session import PanSession
from sim.types import Pose

from .crash_writer import WALK, walk_until_killed
from .small_world import SCENE_DIGEST, env, episode, study
from .stores import filled

Ack = tuple[int, int, Pose]


def received(pipe: Connection, count: int) -> list[Ack]:
    """The next `count` acknowledgements."""
    acks = []
    for _ in range(count):
        assert pipe.poll(60)
        acks.append(pipe.recv())
    return acks


def left_over(pipe: Connection) -> list[Ack]:
    """Acknowledgements that were sent before the kill; the last may be cut off."""
    acks: list[Ack] = []
    try:
        while pipe.poll(0):
            acks.append(pipe.recv())
    except (EOFError, OSError):
        pass
    return acks


@pytest.mark.parametrize(
    "kills", [pytest.param(10, marks=pytest.mark.slow), pytest.param(50, marks=pytest.mark.release)]
)
def test_a_trial_survives_kills_at_random_instants(tmp_path: Path, kills: int) -> None:
    config = study()
    filled(tmp_path, config).close()
    rng = np.random.default_rng(7)
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(["tests.human_study.crash_writer"])
    resumed_at_step = 0
    for _ in range(kills):
        pipe, far_end = context.Pipe(duplex=False)
        writer = context.Process(target=walk_until_killed, args=(tmp_path, far_end))
        writer.start()
        far_end.close()
        acks = received(pipe, int(rng.integers(1, 8)))
        time.sleep(rng.uniform(0, 0.002))  # a random instant between two acknowledgements, not a wait
        assert writer.pid is not None
        os.kill(writer.pid, signal.SIGKILL)
        writer.join(60)
        assert writer.exitcode == -signal.SIGKILL
        acks += left_over(pipe)
        pipe.close()
        assert acks[0][1] == resumed_at_step
        with read_study(tmp_path) as reader:
            reader.check()
            trial_id = reader.trials("p02")[0].trial_id or ""
            stored = reader.events(trial_id)
        last_seq, last_step, last_pose = acks[-1]
        events = [line.event for line in stored]
        steps = [event.step for event in events if isinstance(event, Act)]
        assert [line.seq for line in stored] == list(range(1, len(stored) + 1))
        assert len(stored) >= last_seq
        # At most the one write that was not acknowledged is there too.
        assert last_step <= len(steps) <= last_step + 1
        assert ([Pose((0.0, 0.0, 0.0), 0.0), *(step.pose for step in steps)])[last_step] == last_pose
        world = env()
        task = config.task_for(episode(), "pan")
        PanSession(world, key=episode().key, task=task, scene_digest=SCENE_DIGEST).after(events)
        assert (len(world.steps), world.pose) == (len(steps), world.poses[len(steps)])
        resumed_at_step = len(steps)

    undisturbed = env()
    for step in range(resumed_at_step):
        undisturbed.step(WALK[step % len(WALK)])
    assert resumed_at_step > kills
    assert undisturbed.poses == world.poses
