"""Simulated participants, who come in through the real gateway and websocket."""
