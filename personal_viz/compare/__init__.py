"""A page with a row per episode: gathers runs, compares people with agents, draws sheets, writes the index."""
