"""People do the same tasks as agents.

The public names are loaded when they are first used: `import human_study` itself loads nothing heavy.
"""

from typing import TYPE_CHECKING

from sim.public_names import loaders_of

if TYPE_CHECKING:
    from .design.planning import make_plan as make_plan
    from .design.study import StudyConfig as Study
    from .design.study import load_study as load_study
    from .report.report import study_report as study_report
    from .store.records import read_study as read_records
    from .store.store import open_store as open_store

_PLACES = {
    "Study": ("human_study.design.study", "StudyConfig"),
    "load_study": ("human_study.design.study", "load_study"),
    "make_plan": ("human_study.design.planning", "make_plan"),
    "open_store": ("human_study.store.store", "open_store"),
    "read_records": ("human_study.store.records", "read_study"),
    "study_report": ("human_study.report.report", "study_report"),
}
"""Module of each public name, and its name there."""
__all__ = [
    "Study",
    "load_study",
    "make_plan",
    "open_store",
    "read_records",
    "study_report",
]

if not TYPE_CHECKING:  # a type checker that saw them would accept any name
    __getattr__, __dir__ = loaders_of(__name__, _PLACES)
