"""Describing the objects of a scan, and refining the captions of an edition; every edit is an appended line."""
