"""The report of a study: people and agents on the same episodes, every number with its interval.

`source` reads runs and records, `trials` makes one long frame of them with a column for each of `measures`, and its
groups are the rows of every table. From them come, in the order of the report:

- `counts`: the flow of people, quartiles, ends, attention, verifications, exclusions;
- `hypotheses`: the primary hypotheses, and agents against each other;
- `rows`: the tables of success and effort by split, by the intervals of `statistics`;
- `effects`: conditions, order and earlier visits, within people;
- `sensitivity`, `agreement`, `checklist`: the sections of these names.

`report` puts all of it into one document. `render` writes it as Markdown, HTML (`page`), CSV and LaTeX, `figures` and
`overlays` draw it, and `glmm` writes data and a script for R. `power` simulates a study before anybody takes part.
"""
