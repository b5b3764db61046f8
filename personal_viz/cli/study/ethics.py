"""Verb `study ethics`: writes documents for an ethics board and a registry, and the texts that participants read."""

from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from human_study.design.plan import PLAN_FILE, load_plan
from human_study.design.study import load_study, write_whole
from human_study.store.records import DATABASE_FILE, read_study
from human_study.texts.documents import ethics_documents
from human_study.texts.participants import CONSENT_FILE, INSTRUCTIONS_FILE, TEXT_FILES, instruction_texts
from human_study.texts.words import filled_text, open_places, words_of


@dataclass
class StudyEthics:
    """Write templates: protocol, information sheet, consent, instructions, data flow, estimate, preregistration."""

    study: Positional[Path]
    out: Path = Path("runs/ethics")

    def run(self) -> int:
        config = load_study(self.study)
        plan = load_plan(self.study, config) if (self.study / PLAN_FILE).is_file() else None
        own = {
            name: (self.study / name).read_text(encoding="utf-8")
            for name in TEXT_FILES
            if (self.study / name).is_file()
        }
        consent = own.get(CONSENT_FILE)
        if consent is not None:
            consent = filled_text(consent, words_of(config, plan=plan), where=self.study / CONSENT_FILE)
        dates = None
        if (self.study / DATABASE_FILE).is_file():
            with read_study(self.study) as reader:
                dates = reader.dates()
        documents = ethics_documents(config, plan, consent=consent, dates=dates)
        for task in config.task:
            words = words_of(config, plan=plan, task=task)
            text = filled_text(own.get(INSTRUCTIONS_FILE, ""), words, where=self.study / INSTRUCTIONS_FILE)
            pages = (text, *instruction_texts(config, task, config.conditions(task)))
            documents[f"instructions-{task}.md"] = "\n".join(page for page in pages if page)
        for name, document in documents.items():
            write_whole(self.out / name, document)
        print(f"Written to {self.out}: {', '.join(documents)}")
        print("They are templates: no ethics board has read them.")
        if dates is not None and dates.num_begun:
            begun = f"the first counted trial was begun on {dates.first}"
            print(f"preregistration.md says that it was written after the first trial: {begun}.")
        marks = Counter(field for document in documents.values() for field in open_places(document))
        if plan is None:
            print(f"The numbers of people and trials come with the plan: personal-viz study plan {self.study}")
        if marks:
            fields = ", ".join(f"{field} (in {count})" for field, count in sorted(marks.items()))
            print(f"{sum(marks.values())} places are to be filled in: {fields}")
        else:
            print("Nothing is left to be filled in. Read every document before you hand it on.")
        return 0
