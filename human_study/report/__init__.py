"""Tables and pictures of people and agents on the same episodes, and how precise a study will be."""
