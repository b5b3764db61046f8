"""Tables, statistics and failures of grounding runs."""
