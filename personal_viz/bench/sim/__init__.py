"""The simulator's benchmark: rendering, walking, loading and browser copies, beside their bounds."""
