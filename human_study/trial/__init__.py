"""One trial as a state machine: commands and the time in, events and a view out, and the trial's outcome."""
