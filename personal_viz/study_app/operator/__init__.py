"""The researcher's view of a served study: the dashboard and `study doctor`."""
