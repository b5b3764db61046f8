"""VLFM: the robot goes to the frontier where pictures fitted the text best, until a detector finds the thing."""
