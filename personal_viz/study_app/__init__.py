"""A study in the browser: gateway, workers, and the screens that participants see."""
