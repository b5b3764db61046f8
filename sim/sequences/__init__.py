"""Home sequences as tasks: what agents are told, runs and their files, measures (docs/home-sequences.md)."""
