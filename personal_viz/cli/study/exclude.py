"""Verb `study exclude`: leaves a trial or a person out of the figures, or takes that back. Nothing is deleted."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from human_study.design.study import load_study
from human_study.store.exclusions import find_target, require_rule_id, rules_before_data
from human_study.store.records import read_study
from human_study.store.requests import Change, Exclusion, UndoneExclusion, change_study
from sim.errors import StudyError, did_you_mean


@dataclass
class StudyExclude:
    """Leave a trial or a participant out of the figures by a rule; nothing is deleted, and --undo takes it back."""

    study: Positional[Path]
    who: Annotated[
        Positional[str],
        arg(
            metavar="p03|p03/12", help="A participant as study status shows them, or one trial: its place in the order."
        ),
    ]
    rule: Annotated[str, arg(help="Id of the rule; those written down before data are in preregistration.md.")]
    reason: Annotated[str | None, arg(help="Why it applies here; published, so name nobody.")] = None
    undo: bool = False
    new_rule: Annotated[bool, arg(help="The rule is new, although its id is almost that of a known one.")] = False

    def run(self) -> int:
        rule_id = require_rule_id(self.rule)
        if not self.undo and not (self.reason or "").strip():
            raise StudyError(
                "--reason: found nothing; expected why the rule applies here. Give one sentence, naming nobody."
            )
        config = load_study(self.study)
        with read_study(self.study) as reader:
            target = find_target(reader, self.who)
            targets = set(target.trial_ids) or {target.code}
            in_force = [entry for entry in reader.exclusions() if not entry.is_undone]
        live = [entry.exclusion_id for entry in in_force if entry.target in targets and entry.rule_id == rule_id]
        rules = rules_before_data(config)
        known = {*rules, *(entry.rule_id for entry in in_force)}
        meant = "" if rule_id in known or self.new_rule or self.undo else did_you_mean(rule_id, sorted(known))
        if meant:
            raise StudyError(
                f"--rule: found {rule_id!r}, which is no known rule.{meant} Nothing was changed; --new-rule "
                "takes it as a rule of its own."
            )
        name = f"{'trial' if target.trial_ids else 'participant'} {self.who}"
        if self.undo and not live:
            raise StudyError(
                f"{name}: rule {rule_id} leaves nothing out here; expected that it does. See study export."
            )
        changes: list[Change] = [UndoneExclusion(exclusion_id=exclusion_id) for exclusion_id in live]
        if not self.undo:
            kind = "trial" if target.trial_ids else "participant"
            changes = [
                Exclusion(target_kind=kind, target=name, rule_id=rule_id, reason=self.reason or "")
                for name in target.trial_ids or (target.code,)
            ]
        change_study(self.study, changes)
        when = "written down before data" if rule_id in rules else "not written down before data"
        done = "counts again" if self.undo else f"is left out by rule {rule_id} ({when})"
        print(
            f"{self.study}: {name} {done}. The records are as they were, and the report's main tables "
            "count every result."
        )
        return 0
