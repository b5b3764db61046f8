"""A study before anybody takes part: `study.yaml`, which episodes, who meets which of them."""
