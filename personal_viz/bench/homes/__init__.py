"""How well recovered and invented homes serve their episodes."""
