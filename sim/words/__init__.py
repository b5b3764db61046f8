"""The words of captions: what an object is called and what colour it has."""
