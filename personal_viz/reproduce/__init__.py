"""The paper's tables on other homes or models: its figures beside ours, and what differs."""
