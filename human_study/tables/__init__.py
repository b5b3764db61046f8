"""A study's records as rows: what is exported, in which formats, under which codes."""
