"""A study's records as files, and whether they hold together: tables, run folders, verification."""
