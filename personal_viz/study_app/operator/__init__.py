"""What the researcher sees of a study that is served: the dashboard and `study doctor`."""
