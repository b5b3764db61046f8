"""Verb `study exclude`: leaves a trial or a person out of the figures, or takes that back. Nothing is deleted."""

from pathlib import Path

from human_study.design.study import load_study
from human_study.store.exclusions import find_target, require_rule_id, rules_before_data
from human_study.store.records import read_study
from human_study.store.requests import Change, Exclusion, UndoneExclusion, change_study
from sim.errors import StudyError


def exclude(
    *, study: Path, trial: str | None, participant: str | None, rule: str, reason: str | None, undo: bool
) -> int:
    """Applies a rule to a trial or a person, or takes it back.

    Args:
        study: Folder; a process that serves it does it, and this waits for that.
        trial: `p03/12`, as `study status` prints it; every attempt of it.
        participant: `p03`; either this or a trial.
        rule: Id of the rule.
        reason: Why it applies here; published with the export, so it names nobody. Not needed with `undo`.
        undo: Take back what this rule left out before.

    Raises:
        StudyError: There is no such trial, person or exclusion, or a process that has the study open does not answer.
    """
    rule_id = require_rule_id(rule)
    if not undo and not (reason or "").strip():
        raise StudyError(
            "--reason: found nothing; expected why the rule applies here. Give one sentence, naming nobody."
        )
    config = load_study(study)
    with read_study(study) as reader:
        target = find_target(reader, trial=trial, participant=participant)
        targets = set(target.trial_ids) or {target.code}
        live = [
            entry.exclusion_id
            for entry in reader.exclusions()
            if entry.target in targets and entry.rule_id == rule_id and not entry.is_undone
        ]
    name = f"{'participant' if participant else 'trial'} {participant or trial}"
    if undo and not live:
        raise StudyError(f"{name}: rule {rule_id} leaves nothing out here; expected that it does. See study export.")
    changes: list[Change] = [UndoneExclusion(exclusion_id=exclusion_id) for exclusion_id in live]
    if not undo:
        kind = "trial" if target.trial_ids else "participant"
        changes = [
            Exclusion(target_kind=kind, target=name, rule_id=rule_id, reason=reason or "")
            for name in target.trial_ids or (target.code,)
        ]
    change_study(study, changes)
    when = "written down before data" if rule_id in rules_before_data(config) else "not written down before data"
    done = "counts again" if undo else f"is left out by rule {rule_id} ({when})"
    print(f"{study}: {name} {done}. The records are as they were, and the report's main tables count every result.")
    return 0
