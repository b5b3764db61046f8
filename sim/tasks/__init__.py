"""PAN and POG: environments, agents, the runner, success rules, measures and run files."""
