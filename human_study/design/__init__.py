"""A study before anybody takes part: `study.yaml`, the choice of episodes, and the plan of people and episodes."""
