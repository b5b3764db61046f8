"""The store's promises hold for any order of acts of people, tabs, crashes and the researcher."""

import itertools
import shutil
import tempfile
from collections import defaultdict
from pathlib import Path

import hypothesis.strategies as st
import pytest
from hypothesis import HealthCheck, settings
from hypothesis.stateful import Bundle, RuleBasedStateMachine, initialize, invariant, multiple, precondition, rule

from human_study.store.lock import rows_noted
from human_study.store.progress import study_progress
from human_study.store.records import StudyReader, num_rows, read_study
from human_study.store.store import StudyStore, SupersededError, Trial, TrialEndedError
from human_study.trial.events import Shown
from sim.errors import StudyError
from sim.tasks.run_files import EpisodeEnd

from .stores import OPEN, started

CODES = st.sampled_from(["p01", "p02", "p03"])
REASONS = st.sampled_from(["stop", "giveup", "abandoned", "technical"])
FLOW = ("consent", "instructions")


class StoreMachine(RuleBasedStateMachine):
    """Everybody must consent first; anybody may leave, come back, withdraw, open the study twice."""

    trials = Bundle("trials")

    def __init__(self) -> None:
        super().__init__()
        self.folder = Path(tempfile.mkdtemp(prefix="store-machine-"))
        self.store: StudyStore | None = None
        self.steps: dict[str, list[int]] = defaultdict(list)
        """Acknowledged events of each trial."""
        self.epochs: dict[str, int] = {}
        self.outcomes: dict[str, str] = {}
        """First acknowledged end of each trial."""
        self.owner: dict[str, str] = {}
        self.consent: dict[str, bool] = {}
        self.withdrawn: set[str] = set()
        self.out: set[str] = set()
        """People who declined or withdrew, for good."""
        self.numbers = itertools.count()

    def teardown(self) -> None:
        if self.store is not None:
            self.store.close()
        shutil.rmtree(self.folder)

    @initialize()
    def begin(self) -> None:
        self.store = started(self.folder, flow=FLOW)

    @rule(code=CODES, given=st.booleans())
    def answer_about_consent(self, code: str, given: bool) -> None:
        self.store.give_consent(code, "text", given=given)
        self.consent[code] = given
        if not given:
            self.out.add(code)

    @rule(target=trials, code=CODES)
    def go_on(self, code: str) -> Trial | object:
        """The participant's next trial in a new tab; refused without consent and for those who left."""
        try:
            due = self.store.next_trial(code)
            if due is None:
                return multiple()
            again = self.store.next_trial(code)
            assert again == due, "the same answer when asked again"
            trial = self.store.open_trial(code, due.order_no)
        except StudyError:
            assert code in self.out or code not in self.consent, code
            return multiple()
        assert self.consent[code]
        assert trial.trial_id not in self.outcomes
        assert trial.epoch == self.epochs.get(trial.trial_id, 0) + 1
        self.epochs[trial.trial_id] = trial.epoch
        self.owner[trial.trial_id] = code
        return trial

    @rule(trial=trials, count=st.integers(1, 3))
    def write(self, trial: Trial, count: int) -> None:
        """Events of a tab; only the newest of a running trial may write, and all or none are stored."""
        steps = [next(self.numbers) for _ in range(count)]
        first = [] if self.steps[trial.trial_id] else [OPEN]
        shown = [Shown(step=step, frame_hash=None) for step in steps]
        try:
            self.store.append_many(trial.trial_id, trial.epoch, [*first, *shown])
        except (SupersededError, TrialEndedError):
            assert not self._is_newest(trial) or self._is_over(trial)
            return
        assert self._is_newest(trial)
        assert not self._is_over(trial)
        self.steps[trial.trial_id] += steps

    @rule(trial=trials, reason=REASONS)
    def finish(self, trial: Trial, reason: str) -> None:
        """The first end stays; later ones change nothing."""
        first = self.outcomes.get(trial.trial_id)
        try:
            stored = self.store.finish_trial(trial.trial_id, EpisodeEnd(reason=reason))
        except TrialEndedError:
            assert trial.code in self.withdrawn or (first is None and self._is_over(trial))
            return
        except StudyError:
            assert not self.steps[trial.trial_id], "a trial without events has no end"
            return
        assert trial.code not in self.withdrawn
        assert stored.reason == (first or reason)
        self.outcomes[trial.trial_id] = stored.reason

    @rule(code=CODES)
    def leave(self, code: str) -> None:
        """A trial under way is abandoned; a trial that was not begun has no end."""
        with read_study(self.folder) as reader:
            running = [
                trial.trial_id for trial in reader.trials(code) if trial.trial_id and trial.is_due and trial.attempt
            ]
        left = {trial_id: "abandoned" for trial_id in running if self.steps[trial_id]}
        self.store.drop_out(code, "away")
        assert self.store.drop_out(code, "away") == 0
        self.outcomes |= left

    @precondition(lambda self: not self.withdrawn)
    @rule(code=CODES)
    def withdraw(self, code: str) -> None:
        self.store.withdraw(code)
        self.withdrawn.add(code)
        self.out.add(code)

    @rule()
    def crash(self) -> None:
        """The program ends without closing anything; a new one opens the same files."""
        # SQLite and the lock keep nothing of a killed process: the files are given up as they are
        survivors = {path.name: path.read_bytes() for path in self.folder.iterdir() if path.name != "study.db-shm"}
        self.store.close()
        shutil.rmtree(self.folder)
        self.folder.mkdir()
        for name, content in survivors.items():
            (self.folder / name).write_bytes(content)
        self.store = started(self.folder, flow=FLOW)

    @invariant()
    def promises_hold(self) -> None:
        if self.store is None:
            return
        with read_study(self.folder) as reader:
            assert reader.check() >= sum(map(len, self.steps.values()))
            assert num_rows(reader._database) == rows_noted(self.folder)
            self._check_events(reader)
            self._check_trials(reader)
            _check_slots(reader)
            found = study_progress(reader, now_ns=0)
        assert sum(slot.num_all for slot in found.slots) == 6

    def _check_events(self, reader: StudyReader) -> None:
        for trial_id, steps in self.steps.items():
            if self.owner[trial_id] in self.withdrawn:
                assert reader.events(trial_id) == ()
                continue
            stored = reader.events(trial_id)
            assert [line.seq for line in stored] == list(range(1, len(stored) + 1))
            assert [line.event.step for line in stored if isinstance(line.event, Shown)] == steps

    def _check_trials(self, reader: StudyReader) -> None:
        ends = reader.rows("SELECT trial_id, end_reason FROM outcome")
        assert dict(ends) == self.outcomes
        assert len(ends) == len(self.outcomes)
        consented = {code for (code,) in reader.rows("SELECT code FROM consent WHERE given = 1")}
        begun = {code for (code,) in reader.rows("SELECT code FROM trial JOIN assignment USING(assignment_id)")}
        assert begun <= consented
        for code in reader.codes():
            places = [trial.order_no for trial in reader.trials(code) if trial.attempt < 2]
            assert len(places) == len(set(places))
            homes = [trial.key.scene for trial in reader.trials(code) if trial.trial_id]
            assert len(homes) == len(set(homes)), "nobody meets a home twice"

    def _is_newest(self, trial: Trial) -> bool:
        return self.epochs[trial.trial_id] == trial.epoch

    def _is_over(self, trial: Trial) -> bool:
        """Whether the trial ended or was given back."""
        with read_study(self.folder) as reader:
            status = [known for known in reader.trials(trial.code) if known.trial_id == trial.trial_id]
        return status[0].has_ended or status[0].is_released


def _check_slots(reader: StudyReader) -> None:
    """Each episode, condition and repetition has at most one live holder."""
    held = reader.rows(
        "SELECT count(*) FROM assignment WHERE phase = 'main' AND NOT EXISTS(SELECT 1 FROM release WHERE"
        " release.assignment_id = assignment.assignment_id) GROUP BY task, condition, split, scene, episode_id, rep"
    )
    assert {count for (count,) in held} <= {1}


StoreMachine.TestCase.settings = settings(
    max_examples=25,
    stateful_step_count=25,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
test_the_promises_hold_in_any_order_of_things = pytest.mark.slow(StoreMachine.TestCase)


def test_the_order_in_which_people_write_changes_nothing_that_is_kept(tmp_path: Path) -> None:
    """The same people do the same things, one after the other or in turns: the same trials, events, ends and places."""
    orders = (["p01"] * 3 + ["p02"] * 3, ["p02", "p01"] * 3, ["p01", "p02", "p02", "p01", "p01", "p02"])
    kept = [_kept_after(tmp_path / str(number), codes) for number, codes in enumerate(orders)]
    assert kept[0] == kept[1] == kept[2]
    assert len(kept[0]) == 6


def _kept_after(folder: Path, codes: list[str]) -> list[tuple[object, ...]]:
    """The records after these people did their next trials in this order."""
    with started(folder, flow=FLOW) as store:
        for person in store.plan.participants:
            store.give_consent(person.code, "text", given=True)
        for code in codes:
            due = store.next_trial(code)
            trial = store.open_trial(code, due.order_no)
            store.append_many(trial.trial_id, trial.epoch, [Shown(step=due.order_no, frame_hash=None)])
            store.finish_trial(trial.trial_id, EpisodeEnd(reason="giveup"))
        assert store.next_trial("p03") is None
    with read_study(folder) as reader:
        return [
            (
                *(trial.code, trial.key, trial.attempt, trial.outcome, trial.prior_visits_scene),
                *(line.event for line in reader.events(trial.trial_id or "")),
            )
            for code in ("p01", "p02")
            for trial in reader.trials(code)
        ]
