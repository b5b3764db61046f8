"""Parts of `personal-viz browse`: what is listed, how owners and objects are linked, what the panels and 3-D show."""
