"""The human study's benchmark: how long a participant's key takes, and how much a served study withstands.

Each `measure_...` takes its settings, an empty `folder` for its own study, the `dataset` of one invented home, and
`progress`, which gets lines about the current work. It returns values for the harness. It raises StudyError if the
study cannot be served, if a bot is not let in, or if bots cannot come back.
"""
