"""Verbs of studies with people: from planning and serving to export and report."""
