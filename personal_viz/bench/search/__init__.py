"""Which agents find things: a paired comparison of search in homes without a scan, its figures and its page."""
