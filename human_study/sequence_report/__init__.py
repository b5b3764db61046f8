"""The report of a study of home sequences (`study report`): people and agents on the same ones, by kind of search."""
