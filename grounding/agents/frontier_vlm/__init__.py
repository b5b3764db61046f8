"""An agent that chooses among frontiers and things by a judge: geometry, or a chat model that sees crops and a map."""
