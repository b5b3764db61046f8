"""`study serve --rerun`: each trial becomes a recording for the researcher, and participants are sent nothing of it."""

from pathlib import Path
from typing import Any

import pyarrow as pa
import pytest
from rerun.chunk import RrdReader

from human_study.export.collect import exported_codes
from human_study.export.study_export import export_study
from human_study.store.records import read_study
from human_study.trial.events import Act
from personal_viz.cli.study.serve import StudyServe
from personal_viz.study_app.gateway.options import ServeOptions
from personal_viz.study_app.operator.served import served
from sim.errors import StudyError
from sim.tasks.run_files import Answer, EpisodeEnd, EpisodeStart, RunInfo, Step, read_run

from .test_no_ground_truth_on_the_wire import HOME, assert_no_answer, marked_dataset  # noqa: F401 - a fixture
from .wire import enter

pytestmark = pytest.mark.slow


def texts(path: Path, entity: str, component: str) -> list[str]:
    """The texts of one component, in the order of steps where they have one."""
    found: list[tuple[int, str]] = []
    for chunk in RrdReader(str(path)).stream():
        if chunk.entity_path != entity:
            continue
        batch: Any = chunk.to_record_batch()
        for name in batch.schema.names:
            if name.split(":")[-1] == component:
                steps = [0] * batch.num_rows if chunk.is_static else batch.column("step").cast(pa.int64()).to_pylist()
                found += [(step, value[0]) for step, value in zip(steps, batch.column(name).to_pylist(), strict=True)]
    return [text for _, text in sorted(found, key=lambda row: row[0])]


def entities(path: Path) -> set[str]:
    """Entity paths of a recording."""
    return {chunk.entity_path for chunk in RrdReader(str(path)).stream()}


def test_both_tasks_are_recorded_and_participants_get_nothing_of_it(marked_dataset: Path, tmp_path: Path) -> None:  # noqa: F811
    live = tmp_path / "live"
    home = ("--dataset", str(marked_dataset), "--scene", HOME, "--split", "easy", "--limit", "1", "--workers", "1")
    command = ["study", "serve", "--out", str(tmp_path / "study"), "--port", "0", *home, "--rerun", str(live)]
    with served(command) as study:
        with enter(study.link("pan")) as walker:
            walker.see_step(0)
            walker.press("Turn left (A or Left)")
            walker.see_step(1)
        with enter(study.link("pan")) as walker_again:
            walker_again.see_step(1)
            walker_again.press("Forward (W or Up)")
            walker_again.see_step(2)
            walker_again.give_up()
            walker_again.receive_until(lambda message: "personalPage.goOn" in str(message))
        with enter(study.link("pog")) as pointer:
            pointer.receive_until(lambda message: "Click the middle of the object" in str(message))
            pointer.give_up()
            pointer.receive_until(lambda message: "personalPage.goOn" in str(message))
        assert study.end() == 0
    for client in (walker, walker_again, pointer):
        assert_no_answer(client.messages, client.buffers, marked_dataset)
        sent = [data.decode("latin-1").lower() for data in client.buffers] + [str(client.messages).lower()]
        assert not any(word in text for text in sent for word in ("rerun", ".rrd"))
    assert_recordings_hold_what_is_stored(tmp_path / "study", live, tmp_path / "runs")


def assert_recordings_hold_what_is_stored(study: Path, live: Path, out: Path) -> None:
    """Each finished trial's recording holds the very lines that `study export` writes, under the study's own codes."""
    exported = {folder.name: read_run(folder) for folder in export_study(study, out)}
    with read_study(study) as reader:
        codes = exported_codes(reader)
        trials = [status for code in reader.codes() for status in reader.trials(code)]
        assert [status.code for status in trials] == ["p01", "p02"]
        for status in trials:
            rrd = live / f"{status.code}-{status.key.split}-{status.key.scene}-{status.key.episode_id}.rrd"
            run_id = f"{reader.config.study}-{status.code}-{status.task}"
            record = f"/runs/{run_id}-{status.code}/record"
            info = RunInfo.model_validate_json(texts(rrd, record, "info")[0])
            published = exported[f"{reader.config.study}-{codes[status.code]}-{status.task}"]
            other = {"created_utc", "versions", "git_commit", "run_id"}  # when and with what it was written, new codes
            assert info.model_dump(exclude=other) == published.info.model_dump(exclude=other)
            assert "/goal/centre" in entities(rrd)
            assert status.trial_id is not None
            if status.task == "pog":
                assert [Answer.model_validate_json(line) for line in texts(rrd, record, "line")] == [status.outcome]
                continue
            start = EpisodeStart.model_validate_json(texts(rrd, record, "start")[-1])
            assert start == published.episodes[0].start.model_copy(update={"participant": status.code})
            steps = [stored.event.step for stored in reader.events(status.trial_id) if isinstance(stored.event, Act)]
            assert [Step.model_validate_json(line) for line in texts(rrd, f"{record}/line", "line")] == steps
            assert len(steps) == 2
            assert EpisodeEnd.model_validate_json(texts(rrd, f"{record}/end", "end")[0]) == status.outcome
            pictures = [
                chunk.num_rows
                for chunk in RrdReader(str(rrd)).stream()
                if chunk.entity_path == f"/runs/{run_id}-{status.code}/camera"
                and any("EncodedImage:blob" in name for name in chunk.to_record_batch().schema.names)
            ]
            assert sum(pictures) == 3, "also of the step before the page was opened again"


def test_one_file_for_a_study_is_refused(marked_dataset: Path, tmp_path: Path) -> None:  # noqa: F811
    with pytest.raises(StudyError, match=r"--rerun x\.rrd: this study has 2 trials; expected one for a single file\."):
        StudyServe(
            dataset=marked_dataset,
            scene=HOME,
            out=tmp_path / "study",
            split=("easy",),
            limit=1,
            rerun="x.rrd",
            serving=ServeOptions(port=0),
        ).run()
    assert not (tmp_path / "study" / "study.db").exists()
