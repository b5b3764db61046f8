"""Annotating the objects of a scan in the browser, and refining the captions of an edition; edits are appended lines."""
