"""The world, the tasks, the episodes, and how well a run did."""
